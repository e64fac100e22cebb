//! Wheel speeds without most of their noise.
//!
//! The wheels' momentum is an input of the fit, and noise of an input biases it. Where the motor
//! torques were recorded their integral carries the steps, and only the slow rest (friction, turning of
//! the body) is smoothed out of the measured speeds, over a long window.

use std::ops::Range;

use whorl_dynamics::PlatformModel;
use whorl_math::line::{Line, window};
use whorl_recording::{Recording, Series};

/// Half of the window with known motor torques \[s\].
const LONG_HALF_S: f64 = 0.5;

/// Measured speeds of all wheels.
pub(super) struct WheelHistory<'a> {
    wheels: Vec<Wheel<'a>>,
    time_s: &'a [f64],
}

struct Wheel<'a> {
    /// Speed, less what the motor has given.
    rest_rad_s: Vec<f64>,
    motor: Option<Motor<'a>>,
}

/// What a motor gives, as speed of its wheel.
struct Motor<'a> {
    index: usize,
    torque: &'a Series<Vec<f64>>,
    spin_inertia_kg_m2: f64,
    /// Integral up to each command.
    integral: Vec<f64>,
}

impl<'a> Motor<'a> {
    fn new(torque: &'a Series<Vec<f64>>, index: usize, spin_inertia_kg_m2: f64) -> Self {
        let mut integral = Vec::with_capacity(torque.len());
        let (mut sum, mut before) = (0.0, None);
        for (t, value) in torque.time_s.iter().zip(&torque.value) {
            if let Some((t0, rate)) = before {
                sum += rate * (t - t0);
            }
            integral.push(sum);
            before = Some((*t, value.get(index).copied().unwrap_or(0.0) / spin_inertia_kg_m2));
        }
        Self { index, torque, spin_inertia_kg_m2, integral }
    }

    /// Acceleration it gives at a time [rad/s^2].
    fn rate(&self, time_s: f64) -> f64 {
        let torque = self.torque.held_at(time_s).and_then(|v| v.get(self.index));
        torque.copied().unwrap_or(0.0) / self.spin_inertia_kg_m2
    }

    /// Speed it has given up to a time [rad/s].
    fn speed(&self, time_s: f64) -> f64 {
        let after = self.torque.time_s.partition_point(|t| *t <= time_s);
        let Some(at) = after.checked_sub(1) else { return 0.0 };
        let began = self.torque.time_s.get(at).copied().unwrap_or(time_s);
        self.integral.get(at).copied().unwrap_or(0.0) + self.rate(time_s) * (time_s - began)
    }
}

impl<'a> WheelHistory<'a> {
    pub fn new(run: &'a Recording, model: &PlatformModel) -> Self {
        let speeds = &run.wheel_speed_rad_s;
        let torque = &run.wheel_torque_command_n_m;
        let wheels = model.wheels().iter().enumerate().map(|(j, wheel)| {
            let known = torque.len() > 1 && torque.value.iter().all(|v| v.len() == model.wheels().len());
            let motor = known.then(|| Motor::new(torque, j, wheel.spin_inertia_kg_m2));
            let given = |t: f64| motor.as_ref().map_or(0.0, |m| m.speed(t));
            let rest_rad_s = speeds
                .time_s
                .iter()
                .zip(&speeds.value)
                .map(|(t, v)| v.get(j).copied().unwrap_or(0.0) - given(*t))
                .collect();
            Wheel { rest_rad_s, motor }
        });
        Self { wheels: wheels.collect(), time_s: &speeds.time_s }
    }

    /// Speed and acceleration of each wheel; without motor torques from samples within `half_s`.
    pub fn at(&self, time_s: f64, half_s: f64) -> (Vec<f64>, Vec<f64>) {
        self.wheels
            .iter()
            .map(|wheel| match &wheel.motor {
                Some(motor) => {
                    let (rest, slope) = self.line(&wheel.rest_rad_s, time_s, LONG_HALF_S);
                    (rest + motor.speed(time_s), slope + motor.rate(time_s))
                }
                None => self.line(&wheel.rest_rad_s, time_s, half_s),
            })
            .unzip()
    }

    /// Value and slope of a straight line through the values around a time.
    fn line(&self, values: &[f64], time_s: f64, half_s: f64) -> (f64, f64) {
        let mut reach_s = 1.001 * half_s;
        let Range { start: mut first, end: mut last } = window(self.time_s, time_s, reach_s);
        for _ in 0..3 {
            if last - first >= 3 {
                break;
            }
            reach_s *= 2.0;
            Range { start: first, end: last } = window(self.time_s, time_s, reach_s);
        }
        let near = || (first..last).filter_map(|k| Some((*self.time_s.get(k)?, *values.get(k)?)));
        match Line::through(near().collect::<Vec<_>>()) {
            Some(line) if last - first >= 2 => (line.at(time_s), line.slope),
            // Far from any other sample: the nearest one stands.
            _ => (values.get(first.min(values.len().saturating_sub(1))).copied().unwrap_or(0.0), 0.0),
        }
    }
}
