//! From what ideal sensors see to a recording: coloured noise, quantisation, jitter of the stamps, lost
//! samples.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;
use whorl_recording::{Mounting, Recording, Series, TrueMotion, VectorChannel};

use super::{between, normal};
use crate::truth::{Plan, SLOT_S, Trace};

/// Standard deviations of the true sensors, of one sample at 100 Hz.
#[derive(Debug, Clone)]
pub struct NoiseLevels {
    pub gyro_rad_s: f64,
    pub accel_m_s2: f64,
    pub vector_rad: f64,
    pub wheel_rad_s: f64,
    pub gyro_turn_on_rad_s: f64,
    pub accel_turn_on_m_s2: f64,
}

/// Share of the variance that is correlated over [`COLOUR_S`].
const COLOURED_SHARE: f64 = 0.12;
const COLOUR_S: f64 = 0.025;
/// Flicker: one slow process per decade, each this share of the white standard deviation.
const FLICKER_SHARE: f64 = 0.012;
const FLICKER_S: [f64; 3] = [3.0, 30.0, 300.0];
/// Standard deviation of the stamps \[s\].
const JITTER_S: f64 = 4e-4;

impl NoiseLevels {
    /// The sensors' true levels: as the parameter file says.
    #[must_use]
    pub fn of(model: &PlatformModel) -> Self {
        let s = &model.sensors;
        Self {
            gyro_rad_s: s.gyro.errors.noise_stddev.x,
            accel_m_s2: s.accelerometer.errors.noise_stddev.x,
            vector_rad: s.vector.map_or(2e-3, |v| v.noise_stddev_rad),
            wheel_rad_s: s.wheel_speed.noise_stddev_rad_s,
            gyro_turn_on_rad_s: s.gyro.errors.bias_turn_on_stddev.x,
            accel_turn_on_m_s2: s.accelerometer.errors.bias_turn_on_stddev.x,
        }
    }

    /// What white noise of one sample would have the same density at low frequency.
    #[must_use]
    pub fn effective(stddev: f64) -> f64 {
        // Density of white noise: variance * dt; of an exponentially correlated one: 2 variance * tau.
        let (white, coloured) = (1.0 - COLOURED_SHARE, COLOURED_SHARE * 2.0 * COLOUR_S / 0.01);
        let fast_flicker = FLICKER_SHARE.powi(2) * 2.0 * FLICKER_S[0] / 0.01;
        stddev * (white + coloured + fast_flicker).sqrt()
    }

    /// Standard deviation of the slow part of the flicker, about its mean over a run.
    #[must_use]
    pub fn slow(stddev: f64) -> f64 {
        stddev * FLICKER_SHARE * 2.0_f64.sqrt()
    }
}

/// The model as it is given to the tool: its noise levels off by a factor.
#[derive(Debug, Clone, Copy)]
pub struct Stated {
    /// Stated standard deviation over the true one, gyro and the rest.
    pub gyro_factor: f64,
    pub other_factor: f64,
}

impl Stated {
    /// A factor between 1/1.5 and 1.5.
    #[must_use]
    pub fn draw(rng: &mut Pcg64) -> Self {
        let factor = |rng: &mut Pcg64| 1.5_f64.powf(between(rng, -1.0, 1.0));
        Self { gyro_factor: factor(rng), other_factor: factor(rng) }
    }

    /// Applies them.
    pub fn apply(&self, model: &mut PlatformModel) {
        let s = &mut model.sensors;
        s.gyro.errors.noise_stddev *= self.gyro_factor;
        s.accelerometer.errors.noise_stddev *= self.other_factor;
        if let Some(vector) = &mut s.vector {
            vector.noise_stddev_rad *= self.other_factor;
        }
        s.wheel_speed.noise_stddev_rad_s *= self.other_factor;
    }
}

/// White, coloured and flicker noise of one axis.
struct Coloured {
    stddev: f64,
    coloured: f64,
    slow: [f64; 3],
    dt_s: f64,
}

impl Coloured {
    fn new(stddev: f64, dt_s: f64, rng: &mut Pcg64) -> Self {
        Self {
            stddev,
            coloured: normal(rng) * stddev * COLOURED_SHARE.sqrt(),
            slow: std::array::from_fn(|_| normal(rng) * stddev * FLICKER_SHARE),
            dt_s,
        }
    }

    fn draw(&mut self, rng: &mut Pcg64) -> f64 {
        let step = |x: f64, stddev: f64, tau: f64, rng: &mut Pcg64| {
            let keep = (-self.dt_s / tau).exp();
            keep * x + stddev * (1.0 - keep * keep).sqrt() * normal(rng)
        };
        self.coloured = step(self.coloured, self.stddev * COLOURED_SHARE.sqrt(), COLOUR_S, rng);
        for (x, tau) in self.slow.iter_mut().zip(FLICKER_S) {
            *x = step(*x, self.stddev * FLICKER_SHARE, tau, rng);
        }
        let white = self.stddev * (1.0 - COLOURED_SHARE).sqrt() * normal(rng);
        white + self.coloured + self.slow.iter().sum::<f64>()
    }
}

fn rounded(x: f64, quantum: f64) -> f64 {
    if quantum > 0.0 { (x / quantum).round() * quantum } else { x }
}

/// Makes the recording. `model` gives only quanta.
#[must_use]
pub fn measure(
    trace: &Trace,
    plan: &Plan,
    levels: &NoiseLevels,
    model: &PlatformModel,
    with_truth: bool,
    rng: &mut Pcg64,
) -> Recording {
    let sensors = &model.sensors;
    let three = |stddev: f64, rng: &mut Pcg64| {
        [Coloured::new(stddev, 0.01, rng), Coloured::new(stddev, 0.01, rng), Coloured::new(stddev, 0.01, rng)]
    };
    let mut gyro_noise = three(levels.gyro_rad_s, rng);
    let mut accel_noise = three(levels.accel_m_s2, rng);
    let gyro_bias = Vector3::from_fn(|_, _| normal(rng) * levels.gyro_turn_on_rad_s);
    let accel_bias = Vector3::from_fn(|_, _| normal(rng) * levels.accel_turn_on_m_s2);

    // Lost: single samples of all channels now and then, and one gap.
    let gap_from = between(rng, 0.3, 0.9) * plan.duration_s;
    let gap = gap_from..gap_from + between(rng, 0.1, 0.5);

    let mut recording = Recording {
        name: plan.name.clone(),
        platform: "whorl_1".to_owned(),
        mounting: if plan.clamped { Mounting::Clamped } else { Mounting::OnBearing },
        closed_loop: plan.closed_loop,
        jet_pulses: if plan.clamped { Vec::new() } else { plan.pulses.clone() },
        ..Recording::default()
    };
    let mut truth = TrueMotion::default();
    for (i, &time_s) in trace.time_s.iter().enumerate() {
        let stamp = (time_s + (normal(rng) * JITTER_S).clamp(-0.004, 0.004)).max(0.0);
        let lost = between(rng, 0.0, 1.0) < 0.004 || gap.contains(&time_s);
        let draw = |noise: &mut [Coloured; 3], rng: &mut Pcg64| {
            Vector3::new(noise[0].draw(rng), noise[1].draw(rng), noise[2].draw(rng))
        };
        let (gyro_error, accel_error) = (draw(&mut gyro_noise, rng), draw(&mut accel_noise, rng));
        let wheel_error: [f64; 3] = std::array::from_fn(|_| normal(rng) * levels.wheel_rad_s);
        if lost {
            continue;
        }
        if let (Some(gyro), Some(force)) = (trace.gyro_b_rad_s.get(i), trace.force_b_m_s2.get(i)) {
            let quantum = sensors.gyro.errors.quantum;
            recording.gyro_b_rad_s.time_s.push(stamp);
            recording.gyro_b_rad_s.value.push((gyro + gyro_bias + gyro_error).map(|x| rounded(x, quantum)));
            let quantum = sensors.accelerometer.errors.quantum;
            recording.specific_force_b_m_s2.time_s.push(stamp);
            recording
                .specific_force_b_m_s2
                .value
                .push((force + accel_bias + accel_error).map(|x| rounded(x, quantum)));
            if with_truth {
                truth.q_world_body.time_s.push(time_s);
                truth.q_world_body.value.push(trace.q_world_body[i]);
                truth.omega_wb_b_rad_s.time_s.push(time_s);
                truth.omega_wb_b_rad_s.value.push(trace.omega_b_rad_s[i]);
            }
        }
        let wheels = &trace.wheel_rad_s[i];
        recording.wheel_speed_rad_s.time_s.push(stamp);
        recording.wheel_speed_rad_s.value.push(
            (0..wheels.len())
                .map(|w| rounded(wheels[w] + wheel_error[w], sensors.wheel_speed.quantum_rad_s))
                .collect(),
        );
    }
    if with_truth {
        recording.truth = Some(truth);
    }
    for (slot, command) in plan.wheel_command_n_m.iter().enumerate() {
        recording.wheel_torque_command_n_m.time_s.push(slot as f64 * SLOT_S);
        recording.wheel_torque_command_n_m.value.push(command.to_vec());
    }
    if plan.has_ballast {
        for (slot, ballast) in plan.ballast_n_m.iter().enumerate() {
            if slot == 0 || plan.ballast_n_m[slot - 1] != *ballast {
                recording.ballast_moment_b_n_m.time_s.push(slot as f64 * SLOT_S);
                recording.ballast_moment_b_n_m.value.push(*ballast);
            }
        }
    }
    if !trace.direction_b.is_empty() {
        let reference_world = sensors.vector.map_or(Vector3::x_axis(), |v| v.reference_direction_world);
        let mut direction_b = Series::default();
        for (time_s, direction) in trace.vector_time_s.iter().zip(&trace.direction_b) {
            let turn = Vector3::from_fn(|_, _| normal(rng) * levels.vector_rad);
            let stamp = (time_s + (normal(rng) * JITTER_S).clamp(-0.004, 0.004)).max(0.0);
            if !gap.contains(time_s) {
                direction_b.time_s.push(stamp);
                direction_b.value.push(
                    Unit::new_normalize(UnitQuaternion::from_scaled_axis(turn) * direction).into_inner(),
                );
            }
        }
        recording.vectors = vec![VectorChannel { reference_world, direction_b }];
    }
    let slow = |values: &[f64], stddev: f64, quantum: f64, rng: &mut Pcg64| Series {
        time_s: trace.vector_time_s.iter().copied().take(values.len()).collect(),
        value: values.iter().map(|x| rounded(x + normal(rng) * stddev, quantum)).collect(),
    };
    recording.bus_voltage_v =
        slow(&trace.volt, sensors.bus_voltage.noise_stddev, sensors.bus_voltage.quantum, rng);
    recording.tank_pressure_pa =
        slow(&trace.pressure_pa, sensors.tank_pressure.noise_stddev, sensors.tank_pressure.quantum, rng);
    recording.temperature_k =
        slow(&trace.temperature_k, sensors.temperature.noise_stddev, sensors.temperature.quantum, rng);
    recording
}
