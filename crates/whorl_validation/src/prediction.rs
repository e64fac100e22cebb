//! Simulates a recording.

use std::ops::Range;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::platform::Wheel;
use whorl_dynamics::{Freedom, InitialState, Plant, PlantError, PlatformModel};
use whorl_math::quaternion_exp;
use whorl_recording::{Channel, Mounting, Recording};
use whorl_trajectory::noise::typical_step_s;
use whorl_trajectory::quiet;

use whorl_trajectory::commands::{Commands, ns};
use whorl_trajectory::smoothing::Motion;

/// Largest integration step \[ns\]: the motion between samples is slow, and valve edges are integration points.
const STEP_NS: i64 = 2_500_000;
/// Of a rig without bearing and effects, sampled slowly: this share of a sample's time, and of the time of its fastest
/// motion. A Runge-Kutta step over a twentieth of a radian errs by 1e-9 of the motion.
const SHARE_OF_SAMPLE: f64 = 0.25;
const SHARE_OF_MOTION: f64 = 0.05;

/// The channels and sensors for which a prediction can be compared with the recording. Speeds of wheels without recorded
/// torques are excluded, since the model's wheels are driven along the recorded speeds.
pub(crate) fn predicted_channels(recording: &Recording) -> impl Iterator<Item = (Channel, usize)> {
    let sensors = recording.vectors.len();
    let commanded = !recording.wheel_torque_command_n_m.is_empty();
    let all = [
        (Channel::Gyro, 1),
        (Channel::Accelerometer, 1),
        (Channel::Vector, sensors),
        (Channel::WheelSpeed, usize::from(commanded)),
    ];
    all.into_iter().flat_map(|(channel, sensors)| (0..sensors).map(move |sensor| (channel, sensor)))
}

/// Samples of one sensor that the model predicts. Speeds of wheels are predicted in any case: the recording's times are
/// those at which the model is stepped.
#[derive(Debug, Clone)]
pub(crate) struct Track<'a> {
    pub channel: Channel,
    pub sensor: usize,
    pub time_s: &'a [f64],
    /// Numbers of a sample.
    width: usize,
}

/// Consecutive samples of each track, as the model reads them or as they were measured; NaN where no prediction was
/// possible.
#[derive(Debug, Clone, Default)]
pub(crate) struct Chunk {
    parts: Vec<Part>,
}

#[derive(Debug, Clone, Default)]
struct Part {
    first: usize,
    width: usize,
    numbers: Vec<f64>,
}

impl Chunk {
    /// Which samples of a track it holds.
    pub fn samples(&self, track: usize) -> Range<usize> {
        let Some(part) = self.parts.get(track) else { return 0..0 };
        part.first..part.first + part.numbers.len() / part.width.max(1)
    }

    /// A number of sample `k` of a track: of an axis or a wheel; NaN where there is none.
    pub fn number(&self, track: usize, k: usize, index: usize) -> f64 {
        self.sample(track, k).get(index).copied().unwrap_or(f64::NAN)
    }

    /// All numbers of sample `k`.
    pub fn sample(&self, track: usize, k: usize) -> &[f64] {
        let Some(part) = self.parts.get(track) else { return &[] };
        let from = k.saturating_sub(part.first) * part.width;
        part.numbers.get(from..from + part.width).unwrap_or_default()
    }
}

/// Simulates a recording repeatedly from different initial states. What is predicted is handed out as it comes: that of
/// a whole run would be as large as its recording.
#[derive(Debug, Clone)]
pub(crate) struct Simulator<'a> {
    recording: &'a Recording,
    commands: &'a Commands<'a>,
    plant: Plant,
    tracks: Vec<Track<'a>>,
    gyro_bias_rad_s: Vector3<f64>,
    force_bias_m_s2: Vector3<f64>,
    first_ns: i64,
}

/// Largest integration step \[ns\]. Stops, springs and slosh may be fast whatever the samples show.
fn step_ns(model: &PlatformModel, recording: &Recording) -> i64 {
    if model.freedom == Freedom::OnBearing || !model.effects.is_empty() {
        return STEP_NS;
    }
    let inertia = model.mass_properties.inertia_b_kg_m2();
    let least_kg_m2 = inertia.symmetric_eigenvalues().min();
    let fastest_rad_s = recording.gyro_b_rad_s.value.iter().map(Vector3::norm).fold(0.0, f64::max);
    let of_wheel = |(j, wheel): (usize, &Wheel)| {
        let speeds = recording.wheel_speed_rad_s.value.iter().filter_map(|speeds| speeds.get(j));
        wheel.spin_inertia_kg_m2 * speeds.fold(0.0, |most: f64, x| most.max(x.abs()))
    };
    let momentum: f64 = model.wheels().iter().enumerate().map(of_wheel).sum();
    let turn_rad_s = momentum / least_kg_m2 + fastest_rad_s * inertia.norm() / least_kg_m2;
    let weight = (model.mass_properties.gravity_offset_b_n_m().norm() / least_kg_m2).sqrt();
    let drag = model.wheels().iter().map(|wheel| wheel.viscous_friction_n_m_s / wheel.spin_inertia_kg_m2);
    let rate = drag.fold(turn_rad_s.max(weight), f64::max);
    let times = &recording.gyro_b_rad_s.time_s;
    let times = if times.is_empty() { &recording.wheel_speed_rad_s.time_s } else { times };
    ns((SHARE_OF_SAMPLE * typical_step_s(times)).min(SHARE_OF_MOTION / rate)).max(STEP_NS)
}

impl<'a> Simulator<'a> {
    /// Of a model (effects included) and a recording. The biases are added to what the model's sensors read.
    ///
    /// # Errors
    /// When the model cannot be simulated.
    pub fn new(
        model: &PlatformModel,
        recording: &'a Recording,
        commands: &'a Commands<'a>,
        gyro_bias_rad_s: Vector3<f64>,
        force_bias_m_s2: Vector3<f64>,
    ) -> Result<Self, PlantError> {
        let wheels = recording.wheel_speed_rad_s.value.first().map_or(0, Vec::len);
        let vectors = recording.vectors.iter().enumerate();
        let vectors = vectors.map(|(j, vector)| (Channel::Vector, j, &vector.direction_b.time_s, 3));
        let tracks = [
            (Channel::Gyro, 0, &recording.gyro_b_rad_s.time_s, 3),
            (Channel::Accelerometer, 0, &recording.specific_force_b_m_s2.time_s, 3),
        ];
        let wheels = [(Channel::WheelSpeed, 0, &recording.wheel_speed_rad_s.time_s, wheels)];
        let tracks: Vec<Track<'_>> = tracks
            .into_iter()
            .chain(vectors)
            .chain(wheels)
            .map(|(channel, sensor, time_s, width)| Track { channel, sensor, time_s, width })
            .collect();
        let first_ns =
            tracks.iter().filter_map(|track| track.time_s.first()).map(|t| ns(*t)).min().unwrap_or(0);
        let start = InitialState { time_ns: first_ns.min(0), ..InitialState::default() };
        let mut plant = Plant::new(&quiet(model, recording), &start, 0)?
            .with_step_ns(step_ns(model, recording))
            .without_random_torque();
        if recording.mounting == Mounting::Clamped {
            plant.set_clamped(true);
        }
        Ok(Self { recording, commands, plant, tracks, gyro_bias_rad_s, force_bias_m_s2, first_ns })
    }

    /// First sample \[s\].
    pub fn first_s(&self) -> f64 {
        self.first_ns as f64 * 1e-9
    }

    /// What is predicted.
    pub fn tracks(&self) -> &[Track<'a>] {
        &self.tracks
    }

    /// The track of a sensor, by its position.
    pub fn track(&self, channel: Channel, sensor: usize) -> Option<usize> {
        self.tracks.iter().position(|track| (track.channel, track.sensor) == (channel, sensor))
    }

    /// Predicts every sample, in order of time, restarting every `horizon_s` (`None`: once). If the simulation
    /// diverges, the rest of the stretch is NaN.
    pub fn walk(&self, horizon_s: Option<f64>) -> Walk<'_> {
        Walk {
            simulator: self,
            plant: self.plant.clone(),
            next: vec![0; self.tracks.len()],
            length_ns: horizon_s.map_or(i64::MAX, ns).max(1),
            next_start_ns: self.first_ns,
            event: self.commands.first_event(self.plant.now_ns()),
            lost: true,
        }
    }

    /// The measurements of the same samples as a prediction's.
    pub fn measured(&self, predicted: &Chunk) -> Chunk {
        let of_track = |(position, track): (usize, &Track<'_>)| {
            let samples = predicted.samples(position);
            let mut part = Part { first: samples.start, width: track.width, numbers: Vec::new() };
            if let Some(series) = self.recording.series(track.channel, track.sensor) {
                let number = |k, index| series.number(k, index).unwrap_or(f64::NAN);
                let numbers = samples.flat_map(|k| (0..track.width).map(move |index| (k, index)));
                part.numbers = numbers.map(|(k, index)| number(k, index)).collect();
            }
            part
        };
        Chunk { parts: self.tracks.iter().enumerate().map(of_track).collect() }
    }

    /// Advances the plant with the recorded commands.
    fn run_to(&self, plant: &mut Plant, event: &mut usize, time_ns: i64, lost: &mut bool) {
        while let Some(due_ns) = self.commands.event_ns(*event).filter(|t| *t <= time_ns) {
            advance(plant, due_ns.max(plant.now_ns()), lost);
            self.commands.tell(*event, plant);
            *event += 1;
        }
        advance(plant, time_ns.max(plant.now_ns()), lost);
    }

    /// Adds what a sensor reads now.
    fn read(&self, plant: &mut Plant, track: &Track<'_>, numbers: &mut Vec<f64>) {
        match track.channel {
            Channel::Gyro => {
                let rate = plant.sample_imu().angular_velocity_rad_s + self.gyro_bias_rad_s;
                numbers.extend_from_slice(rate.as_slice());
            }
            Channel::Accelerometer => {
                let force = plant.sample_imu().specific_force_m_s2 + self.force_bias_m_s2;
                numbers.extend_from_slice(force.as_slice());
            }
            Channel::Vector => {
                if let Some(vector) = self.recording.vectors.get(track.sensor) {
                    numbers.extend_from_slice(direction(plant, &vector.reference_world).as_slice());
                }
            }
            _ => {
                numbers.extend(plant.sample_wheels().iter().map(|wheel| wheel.speed_rad_s).take(track.width))
            }
        }
    }
}

/// A simulation on its way through the recording.
#[derive(Debug, Clone)]
pub(crate) struct Walk<'a> {
    simulator: &'a Simulator<'a>,
    plant: Plant,
    /// The next sample of each track.
    next: Vec<usize>,
    length_ns: i64,
    next_start_ns: i64,
    event: usize,
    lost: bool,
}

impl Walk<'_> {
    /// Time of the next sample \[s\]; `None` behind the last.
    pub fn time_s(&self) -> Option<f64> {
        self.earliest().map(|(_, time_s)| time_s)
    }

    /// The next samples, as long as their times are some that are `wanted`. Each stretch begins with `start(time)`.
    pub fn next(&mut self, wanted: impl Fn(f64) -> bool, start: &dyn Fn(f64) -> Motion) -> Chunk {
        let simulator = self.simulator;
        let parts = simulator.tracks.iter().zip(&self.next);
        let parts =
            parts.map(|(track, first)| Part { first: *first, width: track.width, numbers: Vec::new() });
        let mut chunk = Chunk { parts: parts.collect() };
        while let Some((position, time_s)) = self.earliest().filter(|(_, time_s)| wanted(*time_s)) {
            let (Some(track), Some(part), Some(next)) =
                (simulator.tracks.get(position), chunk.parts.get_mut(position), self.next.get_mut(position))
            else {
                break;
            };
            *next += 1;
            let filled = part.numbers.len() + part.width;
            self.go_to(ns(time_s), start);
            if !self.lost {
                simulator.read(&mut self.plant, track, &mut part.numbers);
            }
            part.numbers.resize(filled, f64::NAN);
        }
        chunk
    }

    /// Track and time of the next sample; of several at one instant that of the first track.
    fn earliest(&self) -> Option<(usize, f64)> {
        let due = self.simulator.tracks.iter().zip(&self.next).enumerate();
        let due = due.filter_map(|(position, (track, next))| Some((position, *track.time_s.get(*next)?)));
        due.min_by_key(|(_, time_s)| ns(*time_s))
    }

    /// Advances to a sample, by way of the beginning of its stretch.
    fn go_to(&mut self, time_ns: i64, start: &dyn Fn(f64) -> Motion) {
        let simulator = self.simulator;
        if time_ns >= self.next_start_ns {
            // On the grid of horizons, at or before this sample.
            let elapsed = (time_ns - simulator.first_ns) / self.length_ns;
            let start_ns = simulator.first_ns.saturating_add(elapsed.saturating_mul(self.length_ns));
            self.next_start_ns = start_ns.saturating_add(self.length_ns);
            simulator.run_to(&mut self.plant, &mut self.event, start_ns, &mut self.lost);
            let motion = start(start_ns as f64 * 1e-9);
            let begun = self.plant.set_motion(
                &motion.q_world_body,
                &motion.omega_wb_b_rad_s,
                &motion.wheel_speed_rad_s,
            );
            self.lost = begun.is_err();
        }
        simulator.run_to(&mut self.plant, &mut self.event, time_ns, &mut self.lost);
    }
}

fn advance(plant: &mut Plant, time_ns: i64, lost: &mut bool) {
    if plant.advance_to(time_ns).is_err() {
        *lost = true;
        // A finite state, so that the plant can continue until the next restart.
        let wheels = plant.gyrostat().model().wheels().len();
        let _ = plant.set_motion(&UnitQuaternion::identity(), &Vector3::zeros(), &vec![0.0; wheels]);
    }
}

/// Reading of a vector sensor with this reference, including the model's misalignment.
fn direction(plant: &Plant, reference: &Unit<Vector3<f64>>) -> Vector3<f64> {
    let misalignment =
        plant.gyrostat().model().sensors.vector.map_or(Vector3::zeros(), |v| v.misalignment_rad);
    let direction = plant.state().q_world_body.inverse_transform_vector(reference);
    quaternion_exp(&misalignment).inverse() * direction
}
