//! A recording laid out on nodes, one for each of its bins.

use nalgebra::{SVector, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{Aid, Need, hard_without, untold_without};
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_recording::{Mounting, OnInterval, Recording, Series};
use whorl_trajectory::bins::{Bins, Mean3, SampleTimes};
use whorl_trajectory::driven_speeds::DrivenSpeeds;
use whorl_trajectory::gimbals::GimbalMotion;
use whorl_trajectory::noise::stamp_jitter_s;
use whorl_trajectory::{Needs, check, wheel_torque};

use crate::DiagnosisError;
use crate::bins::feedback::answers_gyro;
use crate::bins::inputs::{HeldInput, RunningIntegral, ballast};
use crate::bins::jitter::{self, command_jitter};
use crate::bins::noise::{Digits, NoiseLevels};

/// What is needed of a recording.
/// Whether it holds enough is a matter of information, not of seconds.
const NEEDS: Needs = Needs { shortest_s: 0.5, free: false, accelerometer: false };

/// Speeds or torques of the wheels; entries beyond the platform's own stay zero.
pub(crate) type Wheels = [f64; MAX_WHEELS];

/// Means of the wheels' speeds, how many samples each is of, and their mean time less the node's \[s\].
fn wheel_means(bins: &Bins, series: &Series<Vec<f64>>) -> Vec<(Wheels, f64, f64)> {
    let read =
        |speeds: &Vec<f64>| SVector::<f64, MAX_WHEELS>::from_fn(|j, _| speeds.get(j).copied().unwrap_or(0.0));
    bins.means_of(series, 0.0, read).into_iter().map(|m| (m.value.into(), m.count, m.late_s)).collect()
}

/// One vector sensor.
#[derive(Debug, Clone)]
pub(crate) struct VectorRun {
    pub reference_world: Vector3<f64>,
    pub mean: Vec<Mean3>,
    /// In each of the two directions across a sample \[rad\].
    pub noise_rad: f64,
}

/// Gimbals as they were read at one instant.
#[derive(Debug, Clone)]
pub(crate) struct GimbalSample {
    pub time_s: f64,
    pub angle_rad: Vec<f64>,
    pub rate_rad_s: Vec<f64>,
    pub torque_n_m: Vec<f64>,
}

impl GimbalSample {
    /// Those whose stamps agree.
    fn all(recording: &Recording) -> Vec<Self> {
        let (angle, rate, torque) =
            (&recording.gimbal_angle_rad, &recording.gimbal_rate_rad_s, &recording.gimbal_torque_n_m);
        let find = |series: &Series<Vec<f64>>, time_s: f64| {
            let k = series.time_s.partition_point(|t| *t < time_s);
            (series.time_s.get(k) == Some(&time_s)).then(|| series.value.get(k).cloned()).flatten()
        };
        let sample = |(time_s, angle_rad): (&f64, &Vec<f64>)| {
            Some(Self {
                time_s: *time_s,
                angle_rad: angle_rad.clone(),
                rate_rad_s: find(rate, *time_s)?,
                torque_n_m: find(torque, *time_s)?,
            })
        };
        angle.time_s.iter().zip(&angle.value).filter_map(sample).collect()
    }
}

/// A recording on nodes.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub name: String,
    pub clamped: bool,
    /// Axes of the body that the gyro measures.
    pub gyro_axes: [bool; 3],
    pub times: SampleTimes,
    pub gyro: Vec<Mean3>,
    pub accel: Vec<Mean3>,
    /// Which axes the accelerometer has; zero stands in its means on the others.
    pub accel_axes: [bool; 3],
    pub vectors: Vec<VectorRun>,
    pub wheel_speed: Vec<(Wheels, f64, f64)>,
    /// A controller turns the gyro's readings into torque.
    pub answers_gyro: bool,
    /// Without, the torques that the speeds imply stand in.
    pub has_wheel_command: bool,
    pub has_wheel_speed: bool,
    pub wheel_command: Vec<HeldInput>,
    /// Noise that jittering stamps make of changing commands [N m sqrt(s)].
    pub wheel_jitter: Wheels,
    /// Jitter of the commands' stamps \[s\].
    pub stamp_jitter_s: f64,
    /// Intervals in which the bearing's stop is near; empty until the base model is fitted.
    pub near_stop: Vec<bool>,
    /// Edges of pulses in each interval, by jet.
    pub edges: Vec<Vec<usize>>,
    pub body_torque: [HeldInput; 3],
    pub jet_pulses: Vec<Vec<OnInterval>>,
    /// The platform has jets, and nothing says whether they fired.
    pub jets_unrecorded: bool,
    /// At nodes.
    pub pressure_pa: Vec<f64>,
    pub gas_used_kg: Vec<f64>,
    pub voltage_v: Vec<f64>,
    pub temperature_k: Vec<f64>,
    pub ballast_moment: Vec<Vector3<f64>>,
    pub ballast_direction: Vec<Vector3<f64>>,
    pub noise: NoiseLevels,
    /// Latency of gyro and accelerometer that was taken off their stamps \[s\].
    pub latency_s: f64,
    pub remarks: Vec<String>,
    /// Samples of the gimbals that have angle, rate and motor torque.
    pub gimbal_samples: Vec<GimbalSample>,
    /// Of each interval; empty without gimbals.
    pub gimbals: Vec<GimbalMotion>,
    pub has_pressure: bool,
    pub has_voltage: bool,
    pub has_temperature: bool,
    /// The numbers in which the gyro reads.
    pub gyro_digits: Digits,
    /// Samples as they came, their stamps corrected for latency: what bins average away.
    pub raw_gyro: Series<Vector3<f64>>,
    pub raw_accel: Series<Vector3<f64>>,
}

impl Run {
    pub fn nodes(&self) -> usize {
        self.times.node_s.len()
    }

    /// A wheel slower than this may stand still, as far as its tachometer's noise lets one see \[rad/s\].
    pub fn standstill_rad_s(&self, least_rad_s: f64) -> f64 {
        (4.0 * self.noise.wheel).max(least_rad_s)
    }

    /// Whether a sensor tells the heading: one that sees a direction other than the vertical.
    pub fn has_heading(&self) -> bool {
        self.vectors.iter().any(|v| v.reference_world.z.abs() < 0.98 * v.reference_world.norm())
    }

    /// Neither attitude nor momentum can be known: wheels turn, and the gyro is the only sensor.
    pub fn is_blind(&self) -> bool {
        let attitude = !self.vectors.is_empty() || self.accel.iter().any(|a| a.count > 0.0);
        let wheels_turn = self.wheel_command.iter().any(|c| c.mean.iter().any(|u| *u != 0.0));
        !self.clamped && !attitude && !self.has_wheel_speed && wheels_turn
    }

    pub fn time(&self, k: usize) -> f64 {
        self.times.node_s.get(k).copied().unwrap_or(0.0)
    }

    /// Length of interval `k` \[s\].
    pub fn length(&self, k: usize) -> f64 {
        self.time(k + 1) - self.time(k)
    }

    /// Mean time between nodes \[s\].
    pub fn node_s(&self) -> f64 {
        (self.time(self.nodes().saturating_sub(1)) - self.time(0)) / self.nodes().max(2) as f64
    }

    /// Length of interval `k`, 0 after the last node \[s\].
    pub fn length_or_zero(&self, k: usize) -> f64 {
        if k + 1 < self.nodes() { self.length(k) } else { 0.0 }
    }

    /// Node at or before `time_s`.
    pub fn node_at(&self, time_s: f64) -> usize {
        self.times.node_s.partition_point(|t| *t <= time_s).saturating_sub(1)
    }

    /// Checks a recording and lays it out with bins of `bin_s`. Stamps of the inertial unit are taken to have a latency of
    /// `extra_latency_s` beyond that of the model's sensors.
    pub fn new(
        recording: &Recording,
        model: &PlatformModel,
        bin_s: f64,
        extra_latency_s: f64,
        feedback_correlation: f64,
    ) -> Result<Self, DiagnosisError> {
        check(recording, model, &NEEDS)?;
        let clamped = is_clamped(recording, model);
        // Within a bin a low-pass is a delay.
        let latency_s = model.sensors.gyro.errors.lag_s() + extra_latency_s;
        let accel_latency_s = model.sensors.accelerometer.errors.lag_s() + extra_latency_s;
        let base_times: Vec<f64> = if clamped {
            recording.wheel_speed_rad_s.time_s.clone()
        } else {
            recording.gyro_b_rad_s.time_s.iter().map(|t| t - latency_s).collect()
        };
        let bins = Bins::new(&base_times, bin_s).ok_or(DiagnosisError::NoRecording)?;
        let noise = NoiseLevels::measured(recording, model);
        let gyro_digits = crate::bins::noise::digits_of_gyro(recording, model);
        let mut gyro = bins.means(&recording.gyro_b_rad_s, latency_s);
        if let Some(limit) = gyro_digits.clips_at_rad_s {
            bins.drop_clipped(&mut gyro, &recording.gyro_b_rad_s, latency_s, limit);
        }
        let vectors = recording
            .vectors
            .iter()
            .map(|channel| VectorRun {
                reference_world: channel.reference_world.into_inner(),
                mean: bins.means(&channel.direction_b, model.sensors.vector.map_or(0.0, |v| v.latency_s)),
                noise_rad: crate::bins::noise::direction_noise_rad(channel, model),
            })
            .collect();
        let wheels = model.wheels().len();
        let has_wheel_command = !recording.wheel_torque_command_n_m.is_empty();
        let has_wheel_speed = !recording.wheel_speed_rad_s.is_empty();
        let implied = (!has_wheel_command && has_wheel_speed)
            .then(|| wheel_torque::from_speeds(recording, &DrivenSpeeds::of(recording), model));
        let torques = implied.as_ref().unwrap_or(&recording.wheel_torque_command_n_m);
        let wheel_command = (0..wheels)
            .map(|j| {
                // Torques that are made from speeds have their noise, beyond what a motor can.
                let limit = match implied {
                    Some(_) => f64::INFINITY,
                    None => model.wheels().get(j).map_or(0.0, |w| w.max_torque_n_m),
                };
                let signal = RunningIntegral::held(torques, limit, |u| u.get(j).copied().unwrap_or(0.0));
                HeldInput::new(&signal, &bins.times)
            })
            .collect();
        let body_torque = [0, 1, 2].map(|i| {
            let signal = RunningIntegral::held(&recording.body_torque_b_n_m, f64::INFINITY, |g| g[i]);
            HeldInput::new(&signal, &bins.times)
        });
        let stamp_jitter_s = stamp_jitter_s(&recording.wheel_torque_command_n_m.time_s);
        let mut edges: Vec<Vec<usize>> = vec![Vec::new(); bins.times.node_s.len()];
        for (edge_s, jet) in jitter::edges(&recording.jet_pulses) {
            let after = bins.times.node_s.partition_point(|t| *t <= edge_s);
            if let Some(list) = after.checked_sub(1).and_then(|k| edges.get_mut(k)) {
                list.push(jet);
            }
        }
        let (ballast_moment, ballast_direction) =
            ballast(&recording.ballast_moment_b_n_m, &bins.times.node_s);
        let mut run = Self {
            name: recording.name.clone(),
            clamped,
            gyro_axes: recording.gyro_axes(),
            gyro,
            accel_axes: recording.force_axes(),
            accel: bins.means(&recording.specific_force_b_m_s2, accel_latency_s),
            vectors,
            wheel_speed: wheel_means(&bins, &recording.wheel_speed_rad_s),
            answers_gyro: recording.closed_loop || answers_gyro(recording, model, feedback_correlation),
            has_wheel_command,
            has_wheel_speed,
            wheel_command,
            wheel_jitter: command_jitter(&recording.wheel_torque_command_n_m, stamp_jitter_s),
            stamp_jitter_s,
            near_stop: Vec::new(),
            edges,
            body_torque,
            jet_pulses: recording.jet_pulses.clone(),
            jets_unrecorded: !clamped
                && !model.jets().is_empty()
                && recording.jet_pulses.is_empty()
                && recording.body_torque_b_n_m.is_empty(),
            pressure_pa: Vec::new(),
            gas_used_kg: Vec::new(),
            voltage_v: Vec::new(),
            temperature_k: Vec::new(),
            ballast_moment,
            ballast_direction,
            noise,
            latency_s,
            remarks: Vec::new(),
            gimbal_samples: GimbalSample::all(recording),
            gimbals: if recording.gimbal_angle_rad.is_empty() {
                Vec::new()
            } else {
                intervals_of(&bins.times.node_s)
                    .map(|(from, to)| GimbalMotion::between(recording, from, to))
                    .collect()
            },
            has_pressure: recording.tank_pressure_pa.len() > 1,
            has_voltage: recording.bus_voltage_v.len() > 1,
            has_temperature: recording.temperature_k.len() > 1,
            gyro_digits,
            raw_gyro: if clamped { Series::default() } else { earlier(&recording.gyro_b_rad_s, latency_s) },
            raw_accel: if clamped {
                Series::default()
            } else {
                earlier(&recording.specific_force_b_m_s2, accel_latency_s)
            },
            times: bins.times,
        };
        run.set_environment(recording, model)?;
        run.remark_on_missing(recording, model);
        Ok(run)
    }

    fn remark_on_missing(&mut self, recording: &Recording, model: &PlatformModel) {
        let mut missing: Vec<&str> = Vec::new();
        if !self.clamped {
            if recording.specific_force_b_m_s2.is_empty() {
                missing.push(if recording.vectors.len() < 2 {
                    "no accelerometer: tilt is known only through the gyro, so gravity torques, gyro bias and sensor effects are harder to distinguish"
                } else {
                    "no accelerometer: tilt is known from the vector sensors"
                });
            }
            if recording.vectors.is_empty() {
                missing.push("no vector sensor: heading drifts with the gyro's bias, so torques fixed in the room and gyro errors about the vertical are weakly observable");
            }
            if self.jets_unrecorded {
                missing.push(
                    "no jet commands: it is assumed that no jet fired, and no thruster effect can be tested",
                );
            }
        }
        let has_actuators =
            !model.wheels().is_empty() || !model.jets().is_empty() || !model.gyros().is_empty();
        if !has_actuators && recording.body_torque_b_n_m.is_empty() {
            missing.push("no body torque, and the model has no wheels or jets: any torque on the platform appears as a missing torque");
        }
        if !model.wheels().is_empty() {
            if recording.wheel_speed_rad_s.is_empty() {
                missing.push("no wheel speeds: they are predicted from the commands, so wheel friction and inertia are weakly observable");
            }
            if recording.wheel_torque_command_n_m.is_empty() {
                missing.push("no wheel torque commands: friction, windage and supply voltage of the wheels cannot be tested");
            }
        }
        if !model.gyros().is_empty() && recording.gimbal_angle_rad.is_empty() {
            missing
                .push("no gimbal angles: the torque of the control moment gyros appears as a missing torque");
        }
        if recording.tank_pressure_pa.is_empty() && recording.jet_pulses.iter().any(|p| !p.is_empty()) {
            missing.push("no tank pressure: it is predicted from the gas used");
        }
        let no_temperature = format!(
            "no temperature: {} cannot be tested",
            untold_without(Need::Temperature, model).join(", ")
        );
        if recording.temperature_k.is_empty() {
            missing.push(&no_temperature);
        }
        let no_voltage = format!(
            "no bus voltage: it is predicted from the model's discharge, so {} is weakly observable",
            hard_without(Aid::BusVoltage, model).join(", ")
        );
        if has_actuators && recording.bus_voltage_v.is_empty() {
            missing.push(&no_voltage);
        }
        self.remarks = missing.into_iter().map(|text| format!("{}: {text}", self.name)).collect();
        let noise = self.noise;
        for (name, ratio, is_in) in [
            ("gyro", noise.gyro_ratio, !self.clamped),
            ("accelerometer", noise.accel_ratio, !self.clamped),
            ("wheel speed", noise.wheel_ratio, true),
        ] {
            if is_in && ratio.is_finite() && !(0.77..=1.3).contains(&ratio) {
                self.remarks.push(format!(
                    "{}: the {name}'s noise is {ratio:.2} times the model's; the measured level is used",
                    self.name
                ));
            }
        }
    }
}

/// Whether the body was held.
pub(crate) fn is_clamped(recording: &Recording, model: &PlatformModel) -> bool {
    recording.mounting == Mounting::Clamped || !model.freedom.turns()
}

/// From each node to the next; at the last one, to itself.
fn intervals_of(node_s: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    let next = node_s.iter().skip(1).chain(node_s.last());
    node_s.iter().zip(next).map(|(from, to)| (*from, *to))
}

/// A channel with its stamps set back.
fn earlier(series: &Series<Vector3<f64>>, latency_s: f64) -> Series<Vector3<f64>> {
    Series { time_s: series.time_s.iter().map(|t| t - latency_s).collect(), value: series.value.clone() }
}
