//! The measurements of a node, linearised.

use nalgebra::Matrix3;
use whorl_math::{GRAVITY_M_S2, skew, vertical_b};
use whorl_recording::{Channel, Component};

use super::{ACCEL_BIAS, ANGLE, GYRO_BIAS, RATE, System, WHEEL, across};

/// States on which one measurement depends, at most: the accelerometer's on angle, rate and its bias.
const MOST_PARTS: usize = 7;

/// One scalar measurement.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub reading: Component,
    pub node: u32,
    /// Reading less prediction.
    pub residual: f64,
    pub variance: f64,
    count: u8,
    state: [u8; MOST_PARTS],
    factor: [f64; MOST_PARTS],
}

impl Row {
    fn new(reading: Component, node: usize, residual: f64, variance: f64, parts: &[(usize, f64)]) -> Self {
        let mut row = Self {
            reading,
            node: node as u32,
            residual,
            variance,
            count: 0,
            state: [0; MOST_PARTS],
            factor: [0.0; MOST_PARTS],
        };
        let present = parts.iter().filter(|(_, factor)| *factor != 0.0);
        for ((state, factor), part) in row.state.iter_mut().zip(&mut row.factor).zip(present) {
            (*state, *factor) = (part.0 as u8, part.1);
            row.count += 1;
        }
        row
    }

    /// States on which it depends, and how much.
    #[inline]
    pub fn parts(&self) -> impl Iterator<Item = (usize, f64)> {
        let count = usize::from(self.count);
        self.state.iter().zip(&self.factor).take(count).map(|(state, factor)| (usize::from(*state), *factor))
    }
}

impl System<'_> {
    /// Measurements at node `k`.
    pub(super) fn rows(&self, k: usize, rows: &mut Vec<Row>) {
        let (run, noise) = (self.run, &self.run.noise);
        let mut push = |(channel, sensor, index): (Channel, usize, usize),
                        residual,
                        variance,
                        parts: &[(usize, f64)]| {
            rows.push(Row::new(Component::new(channel, sensor, index), k, residual, variance, parts));
        };
        if !run.clamped {
            let (Some(q), Some(omega)) = (self.motion.q.get(k), self.motion.omega.get(k)) else { return };
            let sensors = &self.mechanics.model().sensors;
            if let (Some(mean), Some(predicted)) = (run.gyro.get(k), self.prediction.gyro.get(k))
                && mean.count > 0.0
            {
                for i in (0..3).filter(|i| run.gyro_axes[*i]) {
                    // A gyro at the end of its range no longer follows the rate.
                    let clips = predicted[i].abs() >= sensors.gyro.errors.range * (1.0 - 1e-9);
                    let scale = if clips { 0.0 } else { 1.0 + sensors.gyro.errors.scale[i] };
                    let parts = [(RATE + i, scale), (GYRO_BIAS + i, 1.0)];
                    let variance = noise.gyro[i].powi(2) / mean.count;
                    push((Channel::Gyro, 0, i), mean.value[i] - predicted[i], variance, &parts);
                }
            }
            let up = vertical_b(q);
            if let (Some(mean), Some(predicted)) = (run.accel.get(k), self.prediction.accel.get(k))
                && mean.count > 0.0
            {
                let r = sensors.accelerometer.lever_arm_b_m;
                // What falls freely feels no weight.
                let weight = if self.mechanics.model().freedom.has_weight() { GRAVITY_M_S2 } else { 0.0 };
                let by_angle = skew(&up) * weight;
                let unknown = self.unknown_acceleration(k) * r.norm_squared();
                // d/dw of w x (w x r) = (w . r) I + w r^T - 2 r w^T.
                let by_rate =
                    Matrix3::identity() * omega.dot(&r) + omega * r.transpose() - r * omega.transpose() * 2.0;
                for i in (0..3).filter(|i| run.accel_axes[*i]) {
                    let mut parts = [(0, 0.0); 7];
                    for j in 0..3 {
                        parts[j] = (ANGLE + j, by_angle[(i, j)]);
                        parts[3 + j] = (RATE + j, by_rate[(i, j)]);
                    }
                    parts[6] = (ACCEL_BIAS + i, 1.0);
                    let variance = noise.accel[i].powi(2) / mean.count + unknown;
                    push((Channel::Accelerometer, 0, i), mean.value[i] - predicted[i], variance, &parts);
                }
            }
            for (v, vector) in run.vectors.iter().enumerate() {
                let (Some(mean), Some(seen)) =
                    (vector.mean.get(k), self.prediction.vectors.get(v).and_then(|list| list.get(k)))
                else {
                    continue;
                };
                if mean.count == 0.0 {
                    continue;
                }
                let turned = skew(seen);
                let (e1, e2) = across(seen);
                let difference = mean.value - seen;
                for (axis, e) in [e1, e2].into_iter().enumerate() {
                    let h = turned.transpose() * e;
                    let late = mean.late_s;
                    let parts = [
                        (ANGLE, h.x),
                        (ANGLE + 1, h.y),
                        (ANGLE + 2, h.z),
                        (RATE, h.x * late),
                        (RATE + 1, h.y * late),
                        (RATE + 2, h.z * late),
                    ];
                    let variance = vector.noise_rad.powi(2) / mean.count;
                    push((Channel::Vector, v, axis), difference.dot(&e), variance, &parts);
                }
            }
        }
        if let Some((speeds, count, late_s)) = run.wheel_speed.get(k)
            && *count > 0.0
        {
            let predicted = self.motion.wheel.get(k).copied().unwrap_or_default();
            let rate = self.prediction.wheel_dot.get(k).copied().unwrap_or_default();
            for j in 0..self.wheels() {
                let edge = self.prediction.edge_speed.get(k).map_or(0.0, |e| e[j]);
                let residual = speeds[j] - predicted[j] - rate[j] * late_s - edge;
                let variance = noise.wheel.powi(2) / count;
                push((Channel::WheelSpeed, 0, j), residual, variance, &[(WHEEL + j, 1.0)]);
            }
        }
    }
}
