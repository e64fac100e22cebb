//! Rate and wheel speeds, smoothed with the help of the model's accelerations.

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::{Environment, Gyrostat};
use whorl_recording::{Mounting, Recording, Series};

use super::attitude::{Attitudes, smooth_attitude};
use crate::commands::Commands;
use crate::gimbals::GimbalMotion;
use crate::line::{Value, local_line};

/// Half-width of the average for a smoothed rate or speed \[s\].
pub const HALF_WIDTH_S: f64 = 0.5;

/// Motion at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Attitude, v_world = q v_body.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Wheel speeds [rad/s].
    pub wheel_speed_rad_s: Vec<f64>,
}

/// Motion over a run.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedMotion {
    /// Attitude and biases.
    pub attitude: Attitudes,
    clamped: bool,
    wheels: usize,
    /// Rates without the change that the model predicts, at the gyro's times, and that change.
    rate_left: Series<Vector3<f64>>,
    rate_explained: Vec<Vector3<f64>>,
    wheel_time_s: Vec<f64>,
    /// The same of the wheels' speeds, those of a sample side by side.
    wheel_left: Vec<f64>,
    wheel_explained: Vec<f64>,
}

/// Smooths the motion of a recording; `gyrostat` is the model.
#[must_use]
pub fn smooth(recording: &Recording, gyrostat: &Gyrostat, commands: &Commands<'_>) -> SmoothedMotion {
    let model = gyrostat.model();
    let attitude = smooth_attitude(recording, model);
    let wheels = model.wheels().len();
    let clamped = recording.mounting == Mounting::Clamped || !model.freedom.turns();
    let mut motion = SmoothedMotion {
        clamped,
        wheels,
        rate_left: Series::default(),
        rate_explained: Vec::new(),
        wheel_time_s: recording.wheel_speed_rad_s.time_s.clone(),
        wheel_left: Vec::new(),
        wheel_explained: Vec::new(),
        attitude,
    };
    let speeds = |t: f64| -> Vec<f64> {
        let held = recording.wheel_speed_rad_s.held_at(t).or(recording.wheel_speed_rad_s.value.first());
        held.cloned().unwrap_or_else(|| vec![0.0; wheels])
    };

    let mut explained = Vector3::zeros();
    let mut before: Option<f64> = None;
    for (t, rate) in motion.attitude.rates() {
        if let Some(from) = before.filter(|_| !clamped) {
            let middle = 0.5 * (from + t);
            let wheel_speed = speeds(middle);
            let drive = commands.mean_between(from, t);
            let q = motion.attitude.at(middle);
            let mut environment = Environment::new(model, q, rate);
            environment.time_s = middle;
            environment.wheel_speed_rad_s = &wheel_speed;
            environment.wheel_motor_torque_n_m = &drive.wheel_torque_n_m;
            environment.valve_fraction = &drive.valve_fraction;
            let gimbals = GimbalMotion::between(recording, from, t);
            gimbals.show(&mut environment);
            let equation = gyrostat.rate_equation();
            let ballast = equation.gravity_torque_n_m(&drive.ballast_moment_b_n_m, &environment.vertical_b);
            let outside = drive.body_torque_b_n_m + ballast;
            let accelerations = gyrostat.accelerations(&environment, &[], &outside);
            explained += accelerations.omega_dot_wb_b_rad_s2 * (t - from);
        }
        before = Some(t);
        motion.rate_left.time_s.push(t);
        motion.rate_left.value.push(rate - explained);
        motion.rate_explained.push(explained);
    }

    let mut explained = vec![0.0; wheels];
    let mut before: Option<f64> = None;
    let series = &recording.wheel_speed_rad_s;
    for (t, speed) in series.time_s.iter().zip(&series.value) {
        if let Some(from) = before {
            let drive = commands.mean_between(from, *t);
            let mut environment = Environment::new(model, UnitQuaternion::identity(), Vector3::zeros());
            environment.wheel_speed_rad_s = speed;
            environment.wheel_motor_torque_n_m = &drive.wheel_torque_n_m;
            let torque = gyrostat.wheel_torque_n_m(&environment);
            for ((sum, wheel), torque) in explained.iter_mut().zip(model.wheels()).zip(torque) {
                *sum += torque / wheel.spin_inertia_kg_m2 * (t - from);
            }
        }
        before = Some(*t);
        let speed = |wheel: usize| speed.get(wheel).copied().unwrap_or(0.0);
        motion.wheel_left.extend(explained.iter().enumerate().map(|(j, e)| speed(j) - e));
        motion.wheel_explained.extend_from_slice(&explained);
    }
    motion
}

impl SmoothedMotion {
    /// Motion at a time.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Motion {
        Motion {
            q_world_body: self.attitude.at(time_s),
            omega_wb_b_rad_s: self.rate_at(time_s),
            wheel_speed_rad_s: (0..self.wheels).map(|j| self.wheel_speed_at(j, time_s)).collect(),
        }
    }

    /// Measured rate without the change since the start that the model predicts, at the gyro's times [rad/s].
    #[must_use]
    pub fn rate_left(&self) -> &Series<Vector3<f64>> {
        &self.rate_left
    }

    fn rate_at(&self, time_s: f64) -> Vector3<f64> {
        if self.clamped {
            return Vector3::zeros();
        }
        let of = |values: &[Vector3<f64>], k: usize| values.get(k).copied().unwrap_or_default();
        let times = &self.rate_left.time_s;
        line_or_nearest(times, |k| of(&self.rate_left.value, k), time_s)
            + interpolated(times, |k| of(&self.rate_explained, k), time_s)
    }

    fn wheel_speed_at(&self, wheel: usize, time_s: f64) -> f64 {
        let of = |values: &[f64], k: usize| values.get(k * self.wheels + wheel).copied().unwrap_or(0.0);
        line_or_nearest(&self.wheel_time_s, |k| of(&self.wheel_left, k), time_s)
            + interpolated(&self.wheel_time_s, |k| of(&self.wheel_explained, k), time_s)
    }
}

fn line_or_nearest<T: Value + Default>(times_s: &[f64], value: impl Fn(usize) -> T, time_s: f64) -> T {
    local_line(times_s, &value, time_s, HALF_WIDTH_S)
        .map_or_else(|| interpolated(times_s, &value, time_s), |line| line.at(time_s))
}

/// Linear between samples, the nearest beyond the ends, zero without any.
fn interpolated<T: Value + Default>(times_s: &[f64], value: impl Fn(usize) -> T, time_s: f64) -> T {
    if times_s.is_empty() {
        return T::default();
    }
    let k = times_s.partition_point(|t| *t <= time_s);
    let (before, after) = (k.saturating_sub(1), k.min(times_s.len() - 1));
    let (Some(t0), Some(t1)) = (times_s.get(before), times_s.get(after)) else { return T::default() };
    let share = if t1 > t0 { ((time_s - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { 0.0 };
    value(before) * (1.0 - share) + value(after) * share
}
