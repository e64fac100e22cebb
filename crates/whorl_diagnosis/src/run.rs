//! A recording laid out on nodes: means of the samples in equal bins.

use nalgebra::Vector3;
use whorl_dynamics::gyrostat::MAX_WHEELS;
use whorl_dynamics::{Environment, Gyrostat, PlatformModel};
use whorl_recording::{Mounting, OnInterval, Recording, Series};

use crate::DiagnosisError;
use crate::check::check;
use crate::feedback::answers_gyro;
use crate::implied::implied_wheel_torques;
use crate::inputs::{HeldInput, RunningIntegral, SampleTimes};
use crate::jitter::{self, command_jitter, stamp_jitter_s};
use crate::noise::NoiseLevels;

/// Speeds or torques of the wheels; entries beyond the platform's own stay zero.
pub(crate) type Wheels = [f64; MAX_WHEELS];

/// Mean of a vector channel's samples in a bin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mean3 {
    pub value: Vector3<f64>,
    /// Samples in it; 0 = none.
    pub count: f64,
    /// Their mean time less the node's \[s\].
    pub late_s: f64,
}

/// One vector sensor.
#[derive(Debug, Clone)]
pub(crate) struct VectorRun {
    pub reference_world: Vector3<f64>,
    pub mean: Vec<Mean3>,
}

/// A recording on nodes.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub name: String,
    pub clamped: bool,
    pub times: SampleTimes,
    pub gyro: Vec<Mean3>,
    pub accel: Vec<Mean3>,
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
    /// Edges of pulses in each interval, by jet.
    pub edges: Vec<Vec<usize>>,
    pub body_torque: [HeldInput; 3],
    pub jet_pulses: Vec<Vec<OnInterval>>,
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
    pub has_pressure: bool,
    pub has_voltage: bool,
    pub has_temperature: bool,
    /// Gyro reading at which samples pile up: it clips there [rad/s].
    pub gyro_clips_at_rad_s: Option<f64>,
    /// Step of the gyro's output as seen in the data [rad/s].
    pub gyro_step_rad_s: f64,
    /// Samples as they came, their stamps corrected for latency: what bins average away.
    pub raw_gyro: Series<Vector3<f64>>,
    pub raw_accel: Series<Vector3<f64>>,
}

impl Run {
    pub fn nodes(&self) -> usize {
        self.times.node_s.len()
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

    /// Length of interval `k`, 0 after the last node \[s\].
    pub fn length_or_zero(&self, k: usize) -> f64 {
        if k + 1 < self.nodes() { self.length(k) } else { 0.0 }
    }

    /// Node at or before `time_s`.
    pub fn node_at(&self, time_s: f64) -> usize {
        self.times.node_s.partition_point(|t| *t <= time_s).saturating_sub(1)
    }

    /// Checks a recording and lays it out with bins of `bin_s`.
    pub fn new(recording: &Recording, model: &PlatformModel, bin_s: f64) -> Result<Self, DiagnosisError> {
        check(recording, model)?;
        let clamped = recording.mounting == Mounting::Clamped;
        let latency_s = model.sensors.gyro.errors.latency_s;
        let accel_latency_s = model.sensors.accelerometer.errors.latency_s;
        let base_times: Vec<f64> = if clamped {
            recording.wheel_speed_rad_s.time_s.clone()
        } else {
            recording.gyro_b_rad_s.time_s.iter().map(|t| t - latency_s).collect()
        };
        let (Some(first_s), Some(last_s)) = (base_times.first().copied(), base_times.last().copied()) else {
            return Err(DiagnosisError::NoRecording);
        };
        let bins = (((last_s - first_s) / bin_s).floor() as usize).max(2);
        // Half a sample off, so that jitter does not move samples over a bin's edge.
        let origin_s = first_s - 0.5 * median_step_s(&base_times).min(bin_s);
        let bin_of = |t: f64| {
            let index = (t - origin_s) / bin_s;
            (index >= 0.0 && index < bins as f64).then_some(index as usize)
        };
        let mut samples_s: Vec<Vec<f64>> = vec![Vec::new(); bins];
        for t in &base_times {
            if let Some(bin) = bin_of(*t).and_then(|b| samples_s.get_mut(b)) {
                bin.push(*t);
            }
        }
        let node_s: Vec<f64> = samples_s
            .iter()
            .enumerate()
            .map(|(b, times)| {
                if times.is_empty() {
                    origin_s + (b as f64 + 0.5) * bin_s
                } else {
                    times.iter().sum::<f64>() / times.len() as f64
                }
            })
            .collect();
        let times = SampleTimes { node_s, samples_s };
        let noise = NoiseLevels::measured(recording, model);
        let mean3 =
            |series: &Series<Vector3<f64>>, latency_s: f64| mean_of(series, latency_s, &times, &bin_of);
        let (gyro_clips_at_rad_s, gyro_step_rad_s) = crate::noise::clipping_and_step(recording, model);
        let mut gyro = mean3(&recording.gyro_b_rad_s, latency_s);
        if let Some(limit) = gyro_clips_at_rad_s {
            drop_clipped(&mut gyro, &recording.gyro_b_rad_s, latency_s, limit, &bin_of);
        }
        let vectors = recording
            .vectors
            .iter()
            .map(|channel| VectorRun {
                reference_world: channel.reference_world.into_inner(),
                mean: mean3(&channel.direction_b, model.sensors.vector.map_or(0.0, |v| v.latency_s)),
            })
            .collect();
        let wheels = model.wheels.len();
        let has_wheel_command = !recording.wheel_torque_command_n_m.is_empty();
        let has_wheel_speed = !recording.wheel_speed_rad_s.is_empty();
        let implied =
            (!has_wheel_command && has_wheel_speed).then(|| implied_wheel_torques(recording, model));
        let torques = implied.as_ref().unwrap_or(&recording.wheel_torque_command_n_m);
        let wheel_command = (0..wheels)
            .map(|j| {
                let limit = model.wheels.get(j).map_or(0.0, |w| w.max_torque_n_m);
                let signal = RunningIntegral::held(torques, limit, |u| u.get(j).copied().unwrap_or(0.0));
                HeldInput::new(&signal, &times)
            })
            .collect();
        let body_torque = [0, 1, 2].map(|i| {
            let signal = RunningIntegral::held(&recording.body_torque_b_n_m, f64::INFINITY, |g| g[i]);
            HeldInput::new(&signal, &times)
        });
        let stamp_jitter_s = stamp_jitter_s(&recording.wheel_torque_command_n_m.time_s);
        let mut edges: Vec<Vec<usize>> = vec![Vec::new(); times.node_s.len()];
        for (edge_s, jet) in jitter::edges(&recording.jet_pulses) {
            let after = times.node_s.partition_point(|t| *t <= edge_s);
            if let Some(list) = after.checked_sub(1).and_then(|k| edges.get_mut(k)) {
                list.push(jet);
            }
        }
        let (ballast_moment, ballast_direction) = ballast(&recording.ballast_moment_b_n_m, &times.node_s);
        let mut run = Self {
            name: recording.name.clone(),
            clamped,
            gyro,
            accel: mean3(&recording.specific_force_b_m_s2, accel_latency_s),
            vectors,
            wheel_speed: wheel_means(&recording.wheel_speed_rad_s, &times, &bin_of),
            answers_gyro: recording.closed_loop || answers_gyro(recording, model),
            has_wheel_command,
            has_wheel_speed,
            wheel_command,
            wheel_jitter: command_jitter(&recording.wheel_torque_command_n_m, stamp_jitter_s),
            stamp_jitter_s,
            edges,
            body_torque,
            jet_pulses: recording.jet_pulses.clone(),
            pressure_pa: Vec::new(),
            gas_used_kg: Vec::new(),
            voltage_v: Vec::new(),
            temperature_k: Vec::new(),
            ballast_moment,
            ballast_direction,
            noise,
            latency_s,
            remarks: Vec::new(),
            has_pressure: recording.tank_pressure_pa.len() > 1,
            has_voltage: recording.bus_voltage_v.len() > 1,
            has_temperature: recording.temperature_k.len() > 1,
            gyro_clips_at_rad_s,
            gyro_step_rad_s,
            raw_gyro: if clamped { Series::default() } else { earlier(&recording.gyro_b_rad_s, latency_s) },
            raw_accel: if clamped {
                Series::default()
            } else {
                earlier(&recording.specific_force_b_m_s2, accel_latency_s)
            },
            times,
        };
        run.surroundings(recording, model)?;
        run.remark_on_missing(recording, model);
        Ok(run)
    }

    /// Pressure, gas, voltage and temperature at the nodes: measured, else predicted.
    fn surroundings(&mut self, recording: &Recording, model: &PlatformModel) -> Result<(), DiagnosisError> {
        let gyrostat = Gyrostat::new(model)?;
        let nodes = self.nodes();
        // Gas used by the commanded pulses at nominal thrust.
        let mut edges: Vec<(f64, f64)> = Vec::new();
        for (jet, pulses) in model.jets.iter().zip(&self.jet_pulses) {
            let rate = gyrostat.gas_rate_kg_s(jet.thrust_n);
            for pulse in pulses {
                edges.push((pulse.on_s + jet.opening_delay_s, rate));
                edges.push((pulse.off_s + jet.closing_delay_s, -rate));
            }
        }
        edges.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut used, mut rate, mut since, mut next) = (0.0, 0.0, f64::NEG_INFINITY, 0);
        for k in 0..nodes {
            let t = self.time(k);
            while let Some((edge_s, change)) = edges.get(next).copied().filter(|(edge_s, _)| *edge_s <= t) {
                if rate > 0.0 {
                    used += rate * (edge_s - since);
                }
                rate += change;
                since = edge_s;
                next += 1;
            }
            let so_far = if rate > 1e-12 { used + rate * (t - since) } else { used };
            self.gas_used_kg.push(so_far);
        }
        let sensors = &model.sensors;
        for k in 0..nodes {
            let t = self.time(k);
            let gas_kg = gyrostat.initial_gas_kg() - self.gas_used_kg.get(k).copied().unwrap_or(0.0);
            self.pressure_pa.push(gyrostat.pressure_pa(gas_kg.max(0.0)));
            self.voltage_v.push(model.bus.initial_v - model.bus.discharge_v_s * t);
            self.temperature_k.push(sensors.ambient_temperature_k + sensors.temperature_drift_k_s * t);
        }
        let replace = |slot: &mut Vec<f64>, series: &Series<f64>, times: &[f64], width_s: f64| {
            if series.len() > 1 {
                *slot = smoothed(series, times, width_s);
            }
        };
        replace(&mut self.pressure_pa, &recording.tank_pressure_pa, &self.times.node_s, 5.0);
        replace(&mut self.voltage_v, &recording.bus_voltage_v, &self.times.node_s, 0.15);
        replace(&mut self.temperature_k, &recording.temperature_k, &self.times.node_s, 5.0);
        if self.has_pressure {
            // What is gone from the full tank, not from the start of this run.
            let full_pa = model.tank.initial_pressure_pa.max(1.0);
            let full_kg = gyrostat.initial_gas_kg();
            for (used, pressure) in self.gas_used_kg.iter_mut().zip(&self.pressure_pa) {
                *used = full_kg * (1.0 - pressure / full_pa);
            }
        }
        Ok(())
    }

    fn remark_on_missing(&mut self, recording: &Recording, model: &PlatformModel) {
        let mut missing: Vec<&str> = Vec::new();
        if !self.clamped {
            if recording.specific_force_b_m_s2.is_empty() {
                missing.push("no accelerometer: tilt is known only through the gyro, so gravity torques, gyro bias and sensor effects are harder to tell apart");
            }
            if recording.vectors.is_empty() {
                missing.push("no vector sensor: heading drifts with the gyro's bias, so torques fixed in the room and gyro errors about the vertical are weakly seen");
            }
            if recording.jet_pulses.is_empty()
                && !model.jets.is_empty()
                && recording.body_torque_b_n_m.is_empty()
            {
                missing.push("no jet commands: jets are taken as shut, and no thruster effect can be tested");
            }
        }
        if !model.wheels.is_empty() {
            if recording.wheel_speed_rad_s.is_empty() {
                missing.push("no wheel speeds: they are predicted from the commands, so wheel friction and inertia are weakly seen");
            }
            if recording.wheel_torque_command_n_m.is_empty() {
                missing.push("no wheel torque commands: friction, windage and supply voltage of the wheels cannot be tested");
            }
        }
        if recording.tank_pressure_pa.is_empty() && recording.jet_pulses.iter().any(|p| !p.is_empty()) {
            missing.push("no tank pressure: it is predicted from the gas used");
        }
        if recording.temperature_k.is_empty() {
            missing.push("no temperature: gyro_temperature cannot be tested");
        }
        if recording.bus_voltage_v.is_empty() {
            missing.push("no bus voltage: it is predicted from the model's discharge, so supply_voltage is weakly tested");
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
                    "{}: the {name}'s noise is {ratio:.2} times what the model says; the measured level is used",
                    self.name
                ));
            }
        }
    }

    /// What effects see at node `k` in this motion, wheels and inputs left to the caller.
    pub fn environment<'a>(&'a self, model: &'a PlatformModel, k: usize) -> Environment<'a> {
        let at = |values: &[f64], fallback: f64| values.get(k).copied().unwrap_or(fallback);
        Environment {
            time_s: self.time(k),
            tank_pressure_pa: at(&self.pressure_pa, model.tank.initial_pressure_pa),
            gas_used_kg: at(&self.gas_used_kg, 0.0),
            bus_voltage_v: at(&self.voltage_v, model.bus.initial_v),
            temperature_k: at(&self.temperature_k, model.sensors.ambient_temperature_k),
            ballast_direction: self.ballast_direction.get(k).copied().unwrap_or_default(),
            ..Environment::new(model, nalgebra::UnitQuaternion::identity(), Vector3::zeros())
        }
    }
}

/// A channel with its stamps set back.
fn earlier(series: &Series<Vector3<f64>>, latency_s: f64) -> Series<Vector3<f64>> {
    Series { time_s: series.time_s.iter().map(|t| t - latency_s).collect(), value: series.value.clone() }
}

pub(crate) fn median_step_s(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.01;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Typical time between samples of the channel that sets the nodes \[s\].
pub(crate) fn sample_step_s(recording: &Recording) -> f64 {
    if recording.mounting == Mounting::Clamped {
        median_step_s(&recording.wheel_speed_rad_s.time_s)
    } else {
        median_step_s(&recording.gyro_b_rad_s.time_s)
    }
}

fn mean_of(
    series: &Series<Vector3<f64>>,
    latency_s: f64,
    times: &SampleTimes,
    bin_of: &dyn Fn(f64) -> Option<usize>,
) -> Vec<Mean3> {
    let mut sums = vec![(Vector3::zeros(), 0.0, 0.0); times.node_s.len()];
    for (stamp, value) in series.time_s.iter().zip(&series.value) {
        let t = stamp - latency_s;
        if let Some(slot) = bin_of(t).and_then(|b| sums.get_mut(b)) {
            slot.0 += value;
            slot.1 += 1.0;
            slot.2 += t;
        }
    }
    sums.into_iter()
        .zip(&times.node_s)
        .map(|((sum, count, time), node_s)| {
            if count > 0.0 {
                Mean3 { value: sum / count, count, late_s: time / count - node_s }
            } else {
                Mean3 { value: Vector3::zeros(), count: 0.0, late_s: 0.0 }
            }
        })
        .collect()
}

/// Means that hold a clipped sample say nothing.
fn drop_clipped(
    means: &mut [Mean3],
    series: &Series<Vector3<f64>>,
    latency_s: f64,
    limit: f64,
    bin_of: &dyn Fn(f64) -> Option<usize>,
) {
    for (stamp, value) in series.time_s.iter().zip(&series.value) {
        if value.amax() >= limit * (1.0 - 1e-9)
            && let Some(mean) = bin_of(stamp - latency_s).and_then(|b| means.get_mut(b))
        {
            mean.count = 0.0;
        }
    }
}

fn wheel_means(
    series: &Series<Vec<f64>>,
    times: &SampleTimes,
    bin_of: &dyn Fn(f64) -> Option<usize>,
) -> Vec<(Wheels, f64, f64)> {
    let mut sums = vec![([0.0; MAX_WHEELS], 0.0, 0.0); times.node_s.len()];
    for (t, value) in series.time_s.iter().zip(&series.value) {
        if let Some(slot) = bin_of(*t).and_then(|b| sums.get_mut(b)) {
            for (sum, speed) in slot.0.iter_mut().zip(value) {
                *sum += speed;
            }
            slot.1 += 1.0;
            slot.2 += t;
        }
    }
    for (slot, node_s) in sums.iter_mut().zip(&times.node_s) {
        if slot.1 > 0.0 {
            slot.0.iter_mut().for_each(|x| *x /= slot.1);
            slot.2 = slot.2 / slot.1 - node_s;
        }
    }
    sums
}

/// Commanded moment of the moving masses at the nodes, and the sense of their last travel.
fn ballast(series: &Series<Vector3<f64>>, node_s: &[f64]) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
    let mut moments = Vec::with_capacity(node_s.len());
    let mut directions = Vec::with_capacity(node_s.len());
    let (mut next, mut moment, mut direction) = (0, Vector3::zeros(), Vector3::zeros());
    for t in node_s {
        while let (Some(stamp), Some(value)) = (series.time_s.get(next), series.value.get(next)) {
            if stamp > t {
                break;
            }
            if next > 0 {
                let travel: Vector3<f64> = value - moment;
                for i in 0..3 {
                    if travel[i].abs() > 1e-9 {
                        direction[i] = travel[i].signum();
                    }
                }
            }
            moment = *value;
            next += 1;
        }
        moments.push(moment);
        directions.push(direction);
    }
    (moments, directions)
}

/// Mean of the samples within +-`width_s` of each time; the nearest sample where there is none.
fn smoothed(series: &Series<f64>, times: &[f64], width_s: f64) -> Vec<f64> {
    let mut sums = Vec::with_capacity(series.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for value in &series.value {
        sum += value;
        sums.push(sum);
    }
    times
        .iter()
        .map(|t| {
            let from = series.time_s.partition_point(|s| *s < t - width_s);
            let to = series.time_s.partition_point(|s| *s <= t + width_s);
            match (sums.get(from), sums.get(to)) {
                (Some(a), Some(b)) if to > from => (b - a) / (to - from) as f64,
                _ => {
                    let after = series.time_s.partition_point(|s| s <= t);
                    let nearest = after.saturating_sub(1).min(series.len() - 1);
                    series.value.get(nearest).copied().unwrap_or(0.0)
                }
            }
        })
        .collect()
}
