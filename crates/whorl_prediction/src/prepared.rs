//! A recording and a model, ready to be predicted.

use std::borrow::Cow;

use crate::cells::cell_ends_ns;
use crate::inputs::commands::{Commands, ns};
use crate::inputs::driven_speeds::DrivenSpeeds;
use crate::inputs::quiet;
use crate::inputs::wheel_torque::{along_speeds, go_along_speeds};
use crate::refusal::{Why, counts};
use nalgebra::{Unit, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, MeanInputs};
use whorl_dynamics::{Gyrostat, InitialState, Plant, PlatformModel};
use whorl_math::lanes::fastest_rate_1_s;
use whorl_recording::{Component, Mounting, Recording};

use crate::readings::{Track, tracks};
use crate::refusal::PredictionError;
use crate::settings::Settings;

/// Largest integration step while something touches, or nearly does \[s\]: a twentieth of a radian of the bearing's own stop. Valve edges
/// and commands are integration points anyway.
const STEP_AT_CONTACTS_S: f64 = 2.5e-3;
/// Of any: this share of the time of its fastest motion. A Runge-Kutta step over a twentieth of a radian errs by 3e-9 of the
/// motion, ten minutes of a motion at 1 Hz by 2e-4 of a radian if nothing corrected it.
const SHARE_OF_MOTION: f64 = 0.05;
const SHORTEST_STEP_NS: i64 = 50_000;
const LONGEST_STEP_S: f64 = 1.0;

/// A recording and a model, ready to be predicted.
pub struct Prepared<'a> {
    pub(crate) recording: &'a Recording,
    /// Before its effects correct it,
    pub(crate) given: PlatformModel,
    /// and with its constants corrected by them.
    pub(crate) model: PlatformModel,
    pub(crate) commands: Commands<'a>,
    /// Along which its wheels are driven, where their torques were not recorded.
    pub(crate) driven: Option<DrivenSpeeds>,
    /// At the first reading, in no motion in particular; without noise, with the supplies of this run.
    pub(crate) plant: Plant,
    /// How fast it moves when it moves as fast as it ever was read to [1/s].
    pub(crate) fastest_1_s: f64,
    /// Largest step of plants whose difference is wanted and not their motion \[ns\].
    pub(crate) difference_step_ns: i64,
    /// The command that comes first after the first reading.
    pub(crate) event: usize,
    pub(crate) tracks: Vec<Track<'a>>,
    /// The last instants of cells of readings \[ns\]; none: every instant is one.
    pub(crate) cell_ends_ns: Vec<i64>,
    /// Density of the random walk of each hidden state of its effects.
    pub(crate) hidden_noise: Vec<f64>,
    /// Of each wheel that is driven along its measured speeds: root of the power density of its momentum's noise, body axes [N m s per
    /// root of Hz].
    pub(crate) driven_momentum_roots: Vec<Vector3<f64>>,
    /// Only the wheels move.
    pub(crate) clamped: bool,
    pub(crate) settings: Settings,
}

impl<'a> Prepared<'a> {
    /// Of a recording whose channels fit the model ([`crate::check`]), effects of the model included.
    ///
    /// # Errors
    /// See [`PredictionError`].
    pub fn new(
        recording: &'a Recording,
        model: &PlatformModel,
        settings: Settings,
    ) -> Result<Self, PredictionError> {
        counts(recording, model).map_err(|why| why.of(recording))?;
        let model = as_driven(recording, model);
        let gyrostat = Gyrostat::new(&model)?;
        let clamped = recording.mounting == Mounting::Clamped || !model.freedom.turns();
        let wheels = model.wheels().len();
        let tracks = tracks(recording, &gyrostat.model().sensors, clamped, wheels);
        let first = tracks.iter().filter_map(|track| track.instant_ns(0)).min();
        let Some(first_ns) = first else {
            return Err(Why::NothingToPredict.of(recording).into());
        };
        let cell_ends_ns = cell_ends_ns(&tracks, recording, settings.cell_s);
        let driven = go_along_speeds(recording).then(|| DrivenSpeeds::of(recording));
        let commands = Commands::along(recording, &gyrostat, driven.as_ref());
        let mut hidden_noise = vec![0.0; gyrostat.effects().hidden_states()];
        gyrostat.effects().hidden_noise(&mut hidden_noise);
        let plant = plant_before(recording, &model, &commands, first_ns, clamped)?;
        // As it moves when it moves as fast as it ever was read to.
        let (mut moving, (rate, speeds)) = (plant.clone(), fastest(recording, wheels));
        let _ = moving.set_motion(&plant.state().q_world_body, &rate, &speeds);
        let mut linearised = LinearisedPlant::none(&moving);
        moving.linearise_into(&mut linearised, false);
        let moving = fastest_rate_1_s(&linearised.rate_by_state);
        let fastest_1_s = moving.max(swings_1_s(&model));
        let difference_step_ns = longest_step_ns(LONGEST_STEP_S, fastest_1_s);
        let plant = plant.with_step_ns(difference_step_ns).with_contact_step_ns(ns(STEP_AT_CONTACTS_S));
        let (plant, event) = commands.at_first_reading(plant, first_ns);
        let corrected = gyrostat.model().clone();
        let driven_momentum_roots =
            driven.as_ref().map_or_else(Vec::new, |speeds| momentum_roots(speeds, &corrected));
        Ok(Self {
            recording,
            given: model.into_owned(),
            model: corrected,
            commands,
            driven,
            plant,
            fastest_1_s,
            difference_step_ns,
            event,
            tracks,
            cell_ends_ns,
            hidden_noise,
            driven_momentum_roots,
            clamped,
            settings,
        })
    }

    /// The recording.
    #[must_use]
    pub fn recording(&self) -> &'a Recording {
        self.recording
    }

    /// The model, its constants corrected by its effects.
    #[must_use]
    pub fn model(&self) -> &PlatformModel {
        &self.model
    }

    /// The commands of the run.
    #[must_use]
    pub fn commands(&self) -> &Commands<'a> {
        &self.commands
    }

    /// The numbers that it is predicted with.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Everything that is predicted, in the order of channels and sensors; of a direction what is across it.
    pub fn components(&self) -> impl Iterator<Item = Component> + '_ {
        self.tracks.iter().flat_map(|track| track.components.iter().copied())
    }

    /// Whether only the wheels move.
    #[must_use]
    pub fn is_clamped(&self) -> bool {
        self.clamped
    }

    pub(crate) fn first_ns(&self) -> i64 {
        self.plant.now_ns()
    }

    /// How many numbers are taken in at most.
    pub(crate) fn numbers(&self) -> usize {
        let instants = self.instants();
        self.tracks.iter().map(|track| track.time_s.len().min(instants) * track.components.len()).sum()
    }

    /// How many instants there are at most at which anything is taken in.
    pub(crate) fn instants(&self) -> usize {
        let all = self.tracks.iter().map(|track| track.time_s.len()).sum();
        if self.cell_ends_ns.is_empty() { all } else { self.cell_ends_ns.len() }
    }

    /// When what is read at an instant is taken in \[ns\].
    pub(crate) fn cell_end_ns(&self, instant_ns: i64) -> i64 {
        let next = self.cell_ends_ns.partition_point(|end_ns| *end_ns < instant_ns);
        self.cell_ends_ns.get(next).copied().unwrap_or(instant_ns)
    }

    /// As [`Commands::mean_inputs`].
    pub(crate) fn mean_inputs(&self, instant_ns: i64) -> Option<MeanInputs> {
        self.commands.mean_inputs(&self.model.sensors, instant_ns)
    }

    /// Direction in the world of what a vector sensor sees.
    pub(crate) fn reference(&self, sensor: usize) -> Option<Unit<Vector3<f64>>> {
        self.recording.vectors.get(sensor).map(|vector| vector.reference_world)
    }
}

/// A model as its wheels go in a recording: by the commands, or along their measured speeds.
pub(crate) fn as_driven<'m>(recording: &Recording, model: &'m PlatformModel) -> Cow<'m, PlatformModel> {
    if go_along_speeds(recording) { Cow::Owned(along_speeds(model)) } else { Cow::Borrowed(model) }
}

/// Of each wheel that is driven along its measured speeds.
fn momentum_roots(speeds: &DrivenSpeeds, model: &PlatformModel) -> Vec<Vector3<f64>> {
    let wheels = model.wheels().iter().zip(&speeds.noise_root);
    wheels.map(|(wheel, root)| wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * root)).collect()
}

/// A plant that stands at the first command of a recording, or at its first reading if that is before: until then nothing happens.
pub(crate) fn plant_before(
    recording: &Recording,
    model: &PlatformModel,
    commands: &Commands<'_>,
    first_ns: i64,
    clamped: bool,
) -> Result<Plant, PredictionError> {
    let time_ns = commands.event_ns(0).map_or(first_ns, |command_ns| command_ns.min(first_ns));
    let begun = InitialState { time_ns, ..InitialState::default() };
    let quiet = quiet(model, recording);
    let mut plant = Plant::new(&quiet, &begun, 0)?.without_random_torque().without_latency();
    plant.set_clamped(clamped);
    Ok(plant)
}

/// How fast weight lets the body swing at most, whatever its attitude [rad/s].
fn swings_1_s(model: &PlatformModel) -> f64 {
    if !model.freedom.has_weight() {
        return 0.0;
    }
    let properties = &model.mass_properties;
    let least_kg_m2 = properties.inertia_b_kg_m2().symmetric_eigenvalues().min();
    (properties.gravity_offset_b_n_m().norm() / least_kg_m2).sqrt()
}

/// The fastest rate of the body, body axes, and of each wheel that was read [rad/s].
pub(crate) fn fastest(recording: &Recording, wheels: usize) -> (Vector3<f64>, Vec<f64>) {
    let rates = recording.gyro_b_rad_s.value.iter().copied();
    let rate = rates.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default();
    let speeds = || recording.wheel_speed_rad_s.value.iter();
    let of_wheel =
        |j: usize| speeds().filter_map(move |speeds| speeds.get(j).copied().filter(|x| x.is_finite()));
    let fastest = |j| of_wheel(j).max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
    (rate, (0..wheels).map(fastest).collect())
}

/// Largest integration step \[ns\] for a motion as fast as this [1/s].
fn longest_step_ns(longest_s: f64, fastest_1_s: f64) -> i64 {
    ns(longest_s.min(SHARE_OF_MOTION / fastest_1_s)).max(SHORTEST_STEP_NS)
}
