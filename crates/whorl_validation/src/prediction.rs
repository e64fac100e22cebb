//! Simulates a recording.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_dynamics::platform::Wheel;
use whorl_dynamics::{Freedom, InitialState, Plant, PlantError, PlatformModel};
use whorl_math::quaternion_exp;
use whorl_recording::{Channel, Mounting, Recording, Series};
use whorl_trajectory::line::Line;
use whorl_trajectory::noise::typical_step_s;

use whorl_trajectory::commands::{Commands, ns};
use whorl_trajectory::smoothing::Motion;

/// Largest integration step \[ns\]: the motion between samples is slow, and valve edges are integration points.
const STEP_NS: i64 = 2_500_000;
/// Of a rig without bearing and effects, sampled slowly: this share of a sample's time, and of the time of its fastest
/// motion. A Runge-Kutta step over a twentieth of a radian errs by 1e-9 of the motion.
const SHARE_OF_SAMPLE: f64 = 0.25;
const SHARE_OF_MOTION: f64 = 0.05;

/// Predicted measurements, one for each recorded one; NaN where no prediction was possible.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prediction {
    /// Gyro [rad/s].
    pub gyro_b_rad_s: Vec<Vector3<f64>>,
    /// Accelerometer [m/s^2].
    pub specific_force_b_m_s2: Vec<Vector3<f64>>,
    /// Directions of each vector sensor.
    pub vectors: Vec<Vec<Vector3<f64>>>,
    /// Wheel speeds [rad/s].
    pub wheel_speed_rad_s: Vec<Vec<f64>>,
}

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

impl Prediction {
    /// A number of a channel's sample `k`: of an axis or a wheel.
    #[must_use]
    pub fn number(&self, channel: Channel, sensor: usize, k: usize, index: usize) -> Option<f64> {
        match channel {
            Channel::Gyro => self.gyro_b_rad_s.get(k)?.get(index).copied(),
            Channel::Accelerometer => self.specific_force_b_m_s2.get(k)?.get(index).copied(),
            Channel::Vector => self.vectors.get(sensor)?.get(k)?.get(index).copied(),
            Channel::WheelSpeed => self.wheel_speed_rad_s.get(k)?.get(index).copied(),
            _ => None,
        }
    }
}

/// The next sample.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Sample {
    Gyro(usize),
    Force(usize),
    Vector(usize, usize),
    Wheels(usize),
}

/// Simulates a recording repeatedly from different initial states.
#[derive(Debug, Clone)]
pub struct Simulator<'a> {
    recording: &'a Recording,
    commands: &'a Commands,
    plant: Plant,
    samples: Vec<(i64, Sample)>,
    gyro_bias_rad_s: Vector3<f64>,
    force_bias_m_s2: Vector3<f64>,
    first_ns: i64,
}

/// The model without noise, with the supplies of this run.
fn quiet(model: &PlatformModel, recording: &Recording) -> PlatformModel {
    let mut quiet = model.clone();
    let sensors = &mut quiet.sensors;
    sensors.silence();
    let duration_s = recording.duration_s();
    if let Some((start, slope)) = trend(&recording.temperature_k) {
        sensors.ambient_temperature_k = start;
        sensors.temperature_drift_k_s = if duration_s > 30.0 { slope } else { 0.0 };
    }
    let pressures = &recording.tank_pressure_pa.value;
    if let Some(first) = pressures.get(..pressures.len().min(5)).filter(|p| !p.is_empty()) {
        let mean = first.iter().sum::<f64>() / first.len() as f64;
        if mean > 0.0 {
            quiet.tank_mut().initial_pressure_pa = mean;
        }
    }
    if let Some((start, slope)) = trend(&recording.bus_voltage_v) {
        let load = quiet.bus.sag_v_n_m
            * mean_of(
                recording.wheel_torque_command_n_m.value.iter().map(|u| u.iter().map(|x| x.abs()).sum()),
            );
        quiet.bus.initial_v = start + load;
        quiet.bus.discharge_v_s = if duration_s > 30.0 { -slope } else { 0.0 };
    }
    quiet
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

fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), x| (s + x, n + 1));
    sum / count.max(1) as f64
}

/// Value at time zero and slope of the least-squares line.
fn trend(series: &Series<f64>) -> Option<(f64, f64)> {
    let line = Line::through(series.time_s.iter().copied().zip(series.value.iter().copied()))?;
    Some((line.at(0.0), line.slope))
}

impl<'a> Simulator<'a> {
    /// Of a model (effects included) and a recording. The biases are added to what the model's sensors read.
    ///
    /// # Errors
    /// When the model cannot be simulated.
    pub fn new(
        model: &PlatformModel,
        recording: &'a Recording,
        commands: &'a Commands,
        gyro_bias_rad_s: Vector3<f64>,
        force_bias_m_s2: Vector3<f64>,
    ) -> Result<Self, PlantError> {
        let mut samples = Vec::new();
        let at = |times: &[f64], f: &dyn Fn(usize) -> Sample, samples: &mut Vec<(i64, Sample)>| {
            samples.extend(times.iter().enumerate().map(|(k, t)| (ns(*t), f(k))));
        };
        at(&recording.gyro_b_rad_s.time_s, &Sample::Gyro, &mut samples);
        at(&recording.specific_force_b_m_s2.time_s, &Sample::Force, &mut samples);
        for (j, vector) in recording.vectors.iter().enumerate() {
            at(&vector.direction_b.time_s, &|k| Sample::Vector(j, k), &mut samples);
        }
        at(&recording.wheel_speed_rad_s.time_s, &Sample::Wheels, &mut samples);
        samples.sort_by_key(|(time_ns, _)| *time_ns);
        let first_ns = samples.first().map_or(0, |(t, _)| *t);
        let start = InitialState { time_ns: first_ns.min(0), ..InitialState::default() };
        let mut plant = Plant::new(&quiet(model, recording), &start, 0)?
            .with_step_ns(step_ns(model, recording))
            .without_random_torque();
        if recording.mounting == Mounting::Clamped {
            plant.set_clamped(true);
        }
        Ok(Self { recording, commands, plant, samples, gyro_bias_rad_s, force_bias_m_s2, first_ns })
    }

    /// First sample \[s\].
    #[must_use]
    pub fn first_s(&self) -> f64 {
        self.first_ns as f64 * 1e-9
    }

    /// Last sample \[s\].
    #[must_use]
    pub fn last_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |(t, _)| *t as f64 * 1e-9)
    }

    /// Predicts every sample, restarting from `start(time)` every `horizon_s` (`None`: once). If the simulation
    /// diverges, the rest of the stretch is NaN.
    #[must_use]
    pub fn predict(&self, horizon_s: Option<f64>, start: &dyn Fn(f64) -> Motion) -> Prediction {
        let nan = Vector3::repeat(f64::NAN);
        let r = self.recording;
        let wheels = r.wheel_speed_rad_s.value.first().map_or(0, Vec::len);
        let mut prediction = Prediction {
            gyro_b_rad_s: vec![nan; r.gyro_b_rad_s.len()],
            specific_force_b_m_s2: vec![nan; r.specific_force_b_m_s2.len()],
            vectors: r.vectors.iter().map(|v| vec![nan; v.direction_b.len()]).collect(),
            wheel_speed_rad_s: vec![vec![f64::NAN; wheels]; r.wheel_speed_rad_s.len()],
        };
        let mut plant = self.plant.clone();
        let length_ns = horizon_s.map_or(i64::MAX, ns).max(1);
        let mut next_start_ns = self.first_ns;
        let mut event = self.commands.first_event(plant.now_ns());
        let mut lost = true;
        for (time_ns, sample) in &self.samples {
            if *time_ns >= next_start_ns {
                // On the grid of horizons, at or before this sample.
                let elapsed = (*time_ns - self.first_ns) / length_ns;
                let start_ns = self.first_ns.saturating_add(elapsed.saturating_mul(length_ns));
                next_start_ns = start_ns.saturating_add(length_ns);
                self.run_to(&mut plant, &mut event, start_ns, &mut lost);
                let motion = start(start_ns as f64 * 1e-9);
                lost = plant
                    .set_motion(&motion.q_world_body, &motion.omega_wb_b_rad_s, &motion.wheel_speed_rad_s)
                    .is_err();
            }
            self.run_to(&mut plant, &mut event, *time_ns, &mut lost);
            if !lost {
                self.read(&mut plant, *sample, &mut prediction);
            }
        }
        prediction
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

    fn read(&self, plant: &mut Plant, sample: Sample, prediction: &mut Prediction) {
        match sample {
            Sample::Gyro(k) => {
                if let Some(slot) = prediction.gyro_b_rad_s.get_mut(k) {
                    *slot = plant.sample_imu().angular_velocity_rad_s + self.gyro_bias_rad_s;
                }
            }
            Sample::Force(k) => {
                if let Some(slot) = prediction.specific_force_b_m_s2.get_mut(k) {
                    *slot = plant.sample_imu().specific_force_m_s2 + self.force_bias_m_s2;
                }
            }
            Sample::Vector(j, k) => {
                let reference = self.recording.vectors.get(j).map(|v| v.reference_world);
                let slot = prediction.vectors.get_mut(j).and_then(|v| v.get_mut(k));
                if let (Some(slot), Some(reference)) = (slot, reference) {
                    *slot = direction(plant, &reference);
                }
            }
            Sample::Wheels(k) => {
                if let Some(slot) = prediction.wheel_speed_rad_s.get_mut(k) {
                    for (y, wheel) in slot.iter_mut().zip(plant.sample_wheels()) {
                        *y = wheel.speed_rad_s;
                    }
                }
            }
        }
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
