//! A recording and a model, ready to be predicted.

use std::borrow::Cow;

use crate::cells::cell_ends_ns;
use crate::inputs::commands::{Commands, ns};
use crate::inputs::driven_speeds::DrivenSpeeds;
use crate::inputs::quiet;
use crate::inputs::wheel_torque::{along_speeds, go_along_speeds};
use crate::refusal::counts;
use nalgebra::{Unit, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, MeanInputs, Tangent};
use whorl_dynamics::platform::SensorSuite;
use whorl_dynamics::{Gyrostat, InitialState, Plant, PlatformModel};
use whorl_recording::{Component, Mounting, Recording};

use crate::error::PredictionError;
use crate::layout::Layout;
use crate::readings::{Track, tracks};
use crate::settings::Settings;
use crate::transition::fastest_rate_1_s;

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
    recording: &'a Recording,
    given: PlatformModel,
    /// Constants corrected by its effects.
    model: PlatformModel,
    commands: Commands<'a>,
    /// Along which its wheels are driven, where their torques were not recorded.
    driven: Option<DrivenSpeeds>,
    /// Without noise, with the supplies of this run, before the first reading.
    plant: Plant,
    /// How fast it moves when it moves as fast as it ever was read to [1/s].
    fastest_1_s: f64,
    /// Largest step of plants whose difference is wanted and not their motion \[ns\].
    difference_step_ns: i64,
    event: usize,
    tracks: Vec<Track<'a>>,
    /// The last instants of cells of readings \[ns\]; none: every instant is one.
    cell_ends_ns: Vec<i64>,
    hidden_noise: Vec<f64>,
    /// Of each wheel that is driven along its measured speeds: root of the power density of its momentum's noise, body axes [N m s per
    /// root of Hz].
    driven_momentum_roots: Vec<Vector3<f64>>,
    clamped: bool,
    settings: Settings,
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
        counts(recording, model)?;
        let model = as_driven(recording, model);
        let gyrostat = Gyrostat::new(&model)?;
        let clamped = recording.mounting == Mounting::Clamped || !model.freedom.turns();
        let wheels = model.wheels().len();
        let tracks = tracks(recording, &gyrostat.model().sensors, clamped, wheels);
        let first = tracks.iter().filter_map(|track| track.instant_ns(0)).min();
        let Some(first_ns) = first else {
            return Err(PredictionError::NothingToPredict { run: recording.name.clone() });
        };
        let cell_ends_ns = cell_ends_ns(&tracks, recording, settings.cell_s);
        let driven = go_along_speeds(recording).then(|| DrivenSpeeds::of(recording));
        let commands = Commands::along(recording, &gyrostat, driven.as_ref());
        let mut hidden_noise = vec![0.0; gyrostat.effects().hidden_states()];
        gyrostat.effects().hidden_noise(&mut hidden_noise);
        let plant = plant_before(recording, &model, &commands, first_ns, clamped)?;
        // As it moves when it moves as fast as it ever was read to.
        let moving = moving_fastest(&plant, recording);
        let mut linearised = LinearisedPlant::none(&moving);
        moving.linearise_into(&mut linearised, false);
        let moving = fastest_rate_1_s(&linearised.rate_by_state);
        let fastest_1_s = moving.max(swings_1_s(&model));
        let difference_step_ns = longest_step_ns(LONGEST_STEP_S, fastest_1_s);
        let plant = plant.with_step_ns(difference_step_ns).with_contact_step_ns(ns(STEP_AT_CONTACTS_S));
        let (plant, event) = at_first_reading(&commands, plant, first_ns);
        let corrected = gyrostat.model().clone();
        let driven_momentum_roots =
            driven.as_ref().map_or_else(Vec::new, |speeds| momentum_roots(speeds, &corrected));
        let case = Self {
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
        };
        Ok(case)
    }

    /// Another model on the same recording, from the same instant on, for differences of motions.
    pub(crate) fn varied(&self, model: &PlatformModel) -> Result<OtherModel<'a>, PredictionError> {
        let model = as_driven(self.recording, model);
        let gyrostat = Gyrostat::new(&model)?;
        // Few parameters change when a command comes or what it is.
        let is_told_the_same = self.driven.is_none() && gyrostat.has_valves_of(self.plant.gyrostat());
        let own =
            (!is_told_the_same).then(|| Commands::along(self.recording, &gyrostat, self.driven.as_ref()));
        let commands = own.as_ref().unwrap_or(&self.commands);
        let plant = plant_before(self.recording, &model, commands, self.first_ns(), self.clamped)?;
        let sensors = gyrostat.model().sensors;
        let low_pass_s = |sensors: &SensorSuite| {
            [sensors.gyro.errors.time_constant_s, sensors.accelerometer.errors.time_constant_s]
        };
        let has_own_low_pass = low_pass_s(&sensors) != low_pass_s(&self.model.sensors);
        let plant = plant.with_step_ns(self.difference_step_ns).for_differences(has_own_low_pass);
        let (plant, event) = at_first_reading(commands, plant, self.first_ns());
        let commands = own.filter(|own| *own != self.commands);
        Ok(OtherModel { plant, event, commands, sensors, has_own_low_pass })
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

    /// The model before its effects correct it.
    pub(crate) fn given_model(&self) -> &PlatformModel {
        &self.given
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

    pub(crate) fn tracks(&self) -> &[Track<'a>] {
        &self.tracks
    }

    pub(crate) fn hidden_noise(&self) -> impl Iterator<Item = f64> + '_ {
        self.hidden_noise.iter().copied()
    }

    /// Noise of what wheels that are driven along their measured speeds give the body, each: see the field.
    pub(crate) fn driven_momentum_roots(&self) -> &[Vector3<f64>] {
        &self.driven_momentum_roots
    }

    /// Whether wheels bring the noise of their tachometers.
    pub(crate) fn drives_with_noise(&self) -> bool {
        !self.driven_momentum_roots.is_empty()
    }

    /// Variance that a coordinate of a layout gains by its own random walk in this time \[s\].
    pub(crate) fn walk_variance(&self, layout: Layout, i: usize, after_s: f64) -> f64 {
        layout.walk_variance(&self.model.sensors, &self.hidden_noise, i) * after_s
    }

    /// Coordinates of the plant's state.
    #[must_use]
    pub fn tangent(&self) -> Tangent {
        self.plant.tangent()
    }

    /// Whether only the wheels move.
    #[must_use]
    pub fn is_clamped(&self) -> bool {
        self.clamped
    }

    /// How far hidden states may be from rest at the start, where what is left of an earlier motion pushes with this
    /// torque [N m].
    pub(crate) fn hidden_start_stddev(&self, torque_n_m: f64) -> Vec<f64> {
        self.plant.gyrostat().effects().hidden_start_stddev(self.model(), torque_n_m)
    }

    /// The instant of the first reading \[ns\].
    pub(crate) fn first_ns(&self) -> i64 {
        self.plant.now_ns()
    }

    /// How many numbers are taken in at most.
    pub(crate) fn numbers(&self) -> usize {
        self.tracks.iter().map(|track| self.taken_in(track) * track.components.len()).sum()
    }

    /// How many instants there are at most at which anything is taken in.
    pub(crate) fn instants(&self) -> usize {
        let all = self.tracks.iter().map(|track| track.time_s.len()).sum();
        if self.cell_ends_ns.is_empty() { all } else { self.cell_ends_ns.len() }
    }

    /// How often a sensor is taken in at most.
    fn taken_in(&self, track: &Track<'_>) -> usize {
        let all = track.time_s.len();
        if self.cell_ends_ns.is_empty() { all } else { all.min(self.cell_ends_ns.len()) }
    }

    /// When what is read at an instant is taken in \[ns\].
    pub(crate) fn cell_end_ns(&self, instant_ns: i64) -> i64 {
        let next = self.cell_ends_ns.partition_point(|end_ns| *end_ns < instant_ns);
        self.cell_ends_ns.get(next).copied().unwrap_or(instant_ns)
    }

    /// How fast it moves when it moves as fast as it ever was read to [1/s].
    pub(crate) fn fastest_1_s(&self) -> f64 {
        self.fastest_1_s
    }

    /// The plant at the first reading, in no motion in particular.
    pub(crate) fn plant(&self) -> &Plant {
        &self.plant
    }

    /// What drives the platform over the window of an accelerometer whose readings show this instant \[ns\]; `None` where they are no
    /// means.
    pub(crate) fn mean_inputs(&self, instant_ns: i64) -> Option<MeanInputs> {
        mean_inputs(&self.commands, &self.model.sensors, instant_ns)
    }

    /// Direction in the world of what a vector sensor sees.
    pub(crate) fn reference(&self, sensor: usize) -> Option<Unit<Vector3<f64>>> {
        self.recording.vectors.get(sensor).map(|vector| vector.reference_world)
    }

    /// The command that comes first after the first reading.
    pub(crate) fn first_event(&self) -> usize {
        self.event
    }

    /// Advances a plant with the recorded commands; false where its motion is lost.
    pub(crate) fn run_to(&self, plant: &mut Plant, event: &mut usize, time_ns: i64) -> bool {
        run_to(&self.commands, plant, event, time_ns)
    }
}

/// A model as its wheels go in a recording: by the commands, or along their measured speeds.
fn as_driven<'m>(recording: &Recording, model: &'m PlatformModel) -> Cow<'m, PlatformModel> {
    if go_along_speeds(recording) { Cow::Owned(along_speeds(model)) } else { Cow::Borrowed(model) }
}

/// Of each wheel that is driven along its measured speeds.
fn momentum_roots(speeds: &DrivenSpeeds, model: &PlatformModel) -> Vec<Vector3<f64>> {
    let wheels = model.wheels().iter().zip(&speeds.noise_root);
    wheels.map(|(wheel, root)| wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * root)).collect()
}

/// Another model on a recording that was prepared.
#[derive(Clone)]
pub(crate) struct OtherModel<'a> {
    /// At the first reading, and the next command.
    pub plant: Plant,
    pub event: usize,
    /// What it is told; `None`: what the first model is.
    pub commands: Option<Commands<'a>>,
    pub sensors: SensorSuite,
    /// Its inertial sensors have another low-pass.
    pub has_own_low_pass: bool,
}

impl OtherModel<'_> {
    /// Takes over the motion of the first model's plant before readings that show this instant \[ns\], a little changed or not at all.
    pub fn take_motion_of(&mut self, plant: &Plant, change: &[f64], instant_ns: i64) {
        self.plant.take_motion_of(plant, change);
        if let Some(own) = &self.commands {
            self.plant.average_readings(mean_inputs(own, &self.sensors, instant_ns));
        }
    }

    /// Tells it what is due by now; whether nothing else comes and no valve moves before an instant.
    pub fn is_steady_until(&mut self, case: &Prepared<'_>, time_ns: i64) -> bool {
        let commands = self.commands.as_ref().unwrap_or(&case.commands);
        let now_ns = self.plant.now_ns();
        while commands.event_ns(self.event).is_some_and(|due_ns| due_ns <= now_ns) {
            commands.tell(self.event, &mut self.plant);
            self.event += 1;
        }
        let comes = commands.event_ns(self.event).is_some_and(|due_ns| due_ns < time_ns);
        !comes && !self.plant.has_event_before(time_ns)
    }

    /// As [`Prepared::run_to`].
    pub fn run_to(&mut self, case: &Prepared<'_>, time_ns: i64) -> bool {
        let commands = self.commands.as_ref().unwrap_or(&case.commands);
        run_to(commands, &mut self.plant, &mut self.event, time_ns)
    }
}

/// Advances a plant with these commands; false where its motion is lost. A command of the very instant comes after what is read
/// then: a controller answers to a reading, never before it.
fn run_to(commands: &Commands<'_>, plant: &mut Plant, event: &mut usize, time_ns: i64) -> bool {
    while let Some(due_ns) = commands.event_ns(*event).filter(|t| *t < time_ns) {
        if plant.advance_to(due_ns.max(plant.now_ns())).is_err() {
            return false;
        }
        commands.tell(*event, plant);
        *event += 1;
    }
    plant.advance_to(time_ns.max(plant.now_ns())).is_ok()
}

/// Over the window of an accelerometer whose readings show this instant \[ns\]; `None` where they are no means.
fn mean_inputs(commands: &Commands<'_>, sensors: &SensorSuite, instant_ns: i64) -> Option<MeanInputs> {
    let window_s = sensors.accelerometer.errors.averaging_window_s;
    let (middle_s, half_s) = (instant_ns as f64 * 1e-9, 0.5 * window_s);
    (window_s > 0.0).then(|| commands.mean_between(middle_s - half_s, middle_s + half_s))
}

/// Valves, gas and commands as they are at the first reading, and the next command; the motion until then is nobody's.
fn at_first_reading(commands: &Commands<'_>, plant: Plant, first_ns: i64) -> (Plant, usize) {
    let (mut moved, begun) = (plant.clone(), commands.first_event(plant.now_ns()));
    let mut event = begun;
    if run_to(commands, &mut moved, &mut event, first_ns) { (moved, event) } else { (plant, begun) }
}

/// A plant that stands at the first command of a recording, or at its first reading if that is before: until then nothing happens.
fn plant_before(
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

/// The plant with the fastest rate and wheel speeds that were read.
fn moving_fastest(plant: &Plant, recording: &Recording) -> Plant {
    let mut moving = plant.clone();
    let rates = recording.gyro_b_rad_s.value.iter().copied();
    let rate = rates.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_default();
    let wheels = plant.gyrostat().model().wheels().len();
    let speeds = recording.wheel_speed_rad_s.value.iter();
    let fastest = |j: usize| {
        let of_wheel = speeds.clone().filter_map(|speeds| speeds.get(j));
        of_wheel.copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
    };
    let speeds: Vec<f64> = (0..wheels).map(fastest).collect();
    let _ = moving.set_motion(&plant.state().q_world_body, &rate, &speeds);
    moving
}

/// Largest integration step \[ns\] for a motion as fast as this [1/s].
fn longest_step_ns(longest_s: f64, fastest_1_s: f64) -> i64 {
    ns(longest_s.min(SHARE_OF_MOTION / fastest_1_s)).max(SHORTEST_STEP_NS)
}
