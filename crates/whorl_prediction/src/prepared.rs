//! A recording and a model, ready to be predicted.

use nalgebra::Vector3;
use whorl_dynamics::plant::{LinearisedPlant, MeanInputs};
use whorl_dynamics::{Gyrostat, InitialState, MeasuredSupplies, Plant, PlatformModel};
use whorl_math::lanes::fastest_rate_1_s;
use whorl_recording::{Channel, Component, Recording, Why, counts, supplies};

use crate::commands::{Commands, ns};
use crate::driven_speeds::{DrivenSpeeds, as_driven, go_along_speeds};
use crate::readings::{Track, cell_ends_ns, tracks};
use crate::{PredictionError, Settings};

/// Largest integration step while something touches, or nearly does \[s\]: a twentieth of a radian of the bearing's own stop.
const STEP_AT_CONTACTS_S: f64 = 2.5e-3;
/// Of any: this share of the time of its fastest motion. A Runge-Kutta step errs by 3e-9 of that, ten minutes at 1 Hz uncorrected by 2e-4 of a radian.
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
    pub(crate) event: usize,
    pub(crate) tracks: Vec<Track<'a>>,
    /// The last instants of cells of readings \[ns\]; none: every instant is one.
    pub(crate) cell_ends_ns: Vec<i64>,
    /// Variances of readings of cells about their means, and of which.
    variances_within: Vec<(Component, f64)>,
    /// Of each wheel that is driven along its speeds: root of the power density of its momentum's noise, body axes [N m s per root of Hz].
    pub(crate) driven_momentum_roots: Vec<Vector3<f64>>,
    pub(crate) clamped: bool,
    pub(crate) settings: Settings,
}

impl<'a> Prepared<'a> {
    /// Of a recording whose channels fit the model ([`whorl_recording::check`]), effects of the model included.
    ///
    /// # Errors
    /// See [`PredictionError`].
    pub fn new(
        recording: &'a Recording,
        model: &PlatformModel,
        settings: Settings,
    ) -> Result<Self, PredictionError> {
        counts(recording, model).map_err(|why| why.of(recording))?;
        let given = as_driven(recording, model);
        let gyrostat = Gyrostat::new(&given)?;
        let model = gyrostat.model().clone();
        let clamped = recording.is_clamped(&model);
        let wheels = model.wheels().len();
        let tracks = tracks(recording, &model.sensors, clamped, wheels);
        let first = tracks.iter().filter_map(|track| track.instant_ns(0)).min();
        let first_ns = first.ok_or_else(|| {
            let what = "nothing was recorded that the model predicts".to_owned();
            Why::Unusable(what, "a rate, a force, a direction, or a wheel's speed with its command")
                .of(recording)
        })?;
        let driven = go_along_speeds(recording).then(|| DrivenSpeeds::of(recording));
        let commands = Commands::along(recording, &gyrostat, driven.as_ref());
        let plant = plant_before(&given, &commands, first_ns, clamped, supplies(recording).into())?;
        let (mut moving, (rate, speeds)) = (plant.clone(), fastest(recording, wheels));
        let _ = moving.set_motion(&plant.state().q_world_body, &rate, &speeds);
        let mut linearised = LinearisedPlant::none(&moving);
        moving.linearise_into(&mut linearised, false);
        let fastest_1_s = fastest_rate_1_s(&linearised.rate_by_state).max(swings_1_s(&given));
        let difference_step_ns = ns(LONGEST_STEP_S.min(SHARE_OF_MOTION / fastest_1_s)).max(SHORTEST_STEP_NS);
        let plant = plant.with_step_ns(difference_step_ns).with_contact_step_ns(ns(STEP_AT_CONTACTS_S));
        let (plant, event) = commands.at_first_reading(plant, first_ns);
        let roots = driven.iter().flat_map(|speeds| model.wheels().iter().zip(&speeds.noise_root));
        let roots = roots.map(|(wheel, root)| *wheel.spin_axis_b * (wheel.spin_inertia_kg_m2 * root));
        Ok(Self {
            driven_momentum_roots: roots.collect(),
            cell_ends_ns: cell_ends_ns(&tracks, recording, settings.cell_s),
            variances_within: tracks.iter().flat_map(Track::variances_within).collect(),
            recording,
            given,
            model,
            commands,
            driven,
            plant,
            fastest_1_s,
            difference_step_ns,
            event,
            tracks,
            clamped,
            settings,
        })
    }

    /// The recording.
    pub fn recording(&self) -> &'a Recording {
        self.recording
    }

    /// The model, its constants corrected by its effects.
    pub fn model(&self) -> &PlatformModel {
        &self.model
    }

    /// The numbers that it is predicted with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Everything that is predicted, in the order of channels and sensors; of a direction what is across it.
    pub fn components(&self) -> impl Iterator<Item = Component> + '_ {
        self.tracks.iter().flat_map(|track| track.components.iter().copied())
    }

    /// Whether only the wheels move.
    pub fn is_clamped(&self) -> bool {
        self.clamped
    }

    pub(crate) fn reads(&self, channel: Channel) -> bool {
        self.tracks.iter().any(|track| track.channel == channel)
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

    /// The variance of a reading about the mean of its cell.
    pub(crate) fn variance_within(&self, component: Component) -> Option<f64> {
        self.variances_within.iter().find(|(of, _)| *of == component).map(|(_, variance)| *variance)
    }

    /// Whether the accelerometer's readings are means over a window.
    pub(crate) fn averages_forces(&self) -> bool {
        self.model.sensors.accelerometer.errors.averaging_window_s > 0.0
    }

    pub(crate) fn mean_inputs(&self, instant_ns: i64) -> Option<MeanInputs> {
        self.commands.mean_inputs(&self.model.sensors, instant_ns)
    }
}

/// A plant without noise, with supplies of a run, at the first command or at the first reading if that is before: until then nothing happens.
pub(crate) fn plant_before(
    model: &PlatformModel,
    commands: &Commands<'_>,
    first_ns: i64,
    clamped: bool,
    supplies: std::sync::Arc<MeasuredSupplies>,
) -> Result<Plant, PredictionError> {
    let time_ns = commands.event_ns(0).map_or(first_ns, |command_ns| command_ns.min(first_ns));
    let begun = InitialState { time_ns, ..InitialState::default() };
    let mut quiet = model.clone();
    quiet.sensors.silence();
    let mut plant = Plant::new(&quiet, &begun, 0)?.without_random_torque().without_latency();
    plant.set_clamped(clamped);
    plant.set_supplies(supplies);
    Ok(plant)
}

/// How fast weight lets the body swing at most, whatever its attitude [rad/s].
fn swings_1_s(model: &PlatformModel) -> f64 {
    let properties = &model.mass_properties;
    let least_kg_m2 = properties.inertia_b_kg_m2().symmetric_eigenvalues().min();
    let swings = (properties.gravity_offset_b_n_m().norm() / least_kg_m2).sqrt();
    if model.freedom.has_weight() { swings } else { 0.0 }
}

/// The fastest rate of the body, body axes, and of each wheel that was read [rad/s].
pub(crate) fn fastest(recording: &Recording, wheels: usize) -> (Vector3<f64>, Vec<f64>) {
    let rates = recording.gyro_b_rad_s.value.iter().copied();
    let rate = rates.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default();
    let speeds = || recording.wheel_speed_rad_s.value.iter();
    let of_wheel = |j: usize| speeds().filter_map(move |speeds| speeds.get(j).filter(|x| x.is_finite()));
    let fastest = |j| of_wheel(j).copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
    (rate, (0..wheels).map(fastest).collect())
}
