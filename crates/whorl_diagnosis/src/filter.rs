//! The Kalman filter that whitens a run, and the smoother that improves its trajectory.
//!
//! State: small errors of the trajectory, in this order: attitude (3, body axes), rate (3), gyro bias (3),
//! accelerometer bias (3), wheel speeds, and if asked for an unmodelled torque (3). The filter is linear,
//! so the innovation depends linearly on every parameter, and its sensitivities pass through the same
//! gains (Ljung 1999, section 10.3; Klein and Morelli 2006, filter error method).

use nalgebra::{Matrix3, Vector3};
use whorl_math::{GRAVITY_M_S2, skew, vertical_b};

use crate::mechanics::{Mechanics, Prediction};
use crate::motion::Motion;
use crate::run::Run;

/// First index of each part of the state.
pub(crate) const ANGLE: usize = 0;
pub(crate) const RATE: usize = 3;
pub(crate) const GYRO_BIAS: usize = 6;
pub(crate) const ACCEL_BIAS: usize = 9;
pub(crate) const WHEEL: usize = 12;

/// How the filter is set.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings {
    /// Random-walk intensity of the rate, the torque that the model lacks without memory [rad/s/sqrt(s)].
    pub rate_walk: f64,
    /// Intensity of a random-walk torque state [N m/sqrt(s)]; 0 = no such state.
    pub torque_walk: f64,
    /// Torque noise of the wheels [N m sqrt(s)].
    pub wheel_noise: f64,
}

/// One scalar measurement.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    pub channel: usize,
    /// Reading less prediction.
    pub residual: f64,
    pub variance: f64,
    pub h: Vec<f64>,
}

/// The filter's gains along a run: all that columns need to pass through it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Gains {
    pub n: usize,
    /// Rows of node k: `first_row[k]..first_row[k + 1]`.
    pub first_row: Vec<usize>,
    pub channel: Vec<u8>,
    /// 1 / standard deviation of each innovation.
    pub inverse_stddev: Vec<f64>,
    /// rows x n
    pub h: Vec<f64>,
    pub gain: Vec<f64>,
    /// intervals x n x n
    pub transition: Vec<f64>,
    /// Whitened residual.
    pub whitened: Vec<f64>,
    pub log_likelihood: f64,
    /// Node of each row.
    pub node: Vec<u32>,
}

/// Smoothed errors of the trajectory.
#[derive(Debug, Clone, Default)]
pub(crate) struct Smoothed {
    /// nodes x n
    pub state: Vec<f64>,
    /// Variance of the torque states, nodes x 3; empty without them.
    pub torque_variance: Vec<f64>,
}

/// Two axes across a direction.
pub(crate) fn across(direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = if direction.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
    let e1 = direction.cross(&helper);
    let e1 = e1 / e1.norm().max(1e-12);
    (e1, direction.cross(&e1))
}

/// Linearised system of one run.
pub(crate) struct System<'a> {
    pub run: &'a Run,
    pub motion: &'a Motion,
    pub mechanics: &'a Mechanics,
    pub prediction: &'a Prediction,
    pub settings: Settings,
}

fn put(matrix: &mut [f64], n: usize, row: usize, column: usize, block: &Matrix3<f64>) {
    for i in 0..3 {
        for j in 0..3 {
            matrix[(row + i) * n + column + j] = block[(i, j)];
        }
    }
}

impl System<'_> {
    pub fn wheels(&self) -> usize {
        self.mechanics.model().wheels.len()
    }

    pub fn states(&self) -> usize {
        WHEEL + self.wheels() + if self.settings.torque_walk > 0.0 { 3 } else { 0 }
    }

    /// Continuous-time matrix of the error dynamics in the middle of interval `k`.
    fn slope(&self, k: usize, a: &mut [f64]) {
        let n = self.states();
        a.fill(0.0);
        let model = self.mechanics.model();
        if self.run.clamped {
            for (j, wheel) in model.wheels.iter().enumerate() {
                a[(WHEEL + j) * n + WHEEL + j] = -wheel.viscous_friction_n_m_s / wheel.spin_inertia_kg_m2;
            }
            return;
        }
        let (Some(q), Some(omega), Some(speed)) =
            (self.motion.q_mid.get(k), self.motion.omega_mid.get(k), self.motion.wheel_mid.get(k))
        else {
            return;
        };
        let inverse = &self.mechanics.inverse_inertia;
        let inertia = model.mass_properties.inertia_b_kg_m2();
        let up = vertical_b(q);
        let mut offset = *model.mass_properties.gravity_offset_b_n_m();
        offset += self.run.ballast_moment.get(k).copied().unwrap_or_default();
        put(a, n, ANGLE, ANGLE, &-skew(omega));
        put(a, n, ANGLE, RATE, &Matrix3::identity());
        let momentum = self.mechanics.gyrostat.momentum_b_n_m_s(omega, &speed[..self.wheels()]);
        let rate_angle = inverse * (-skew(&offset) * skew(&up));
        let rate_rate = inverse * (skew(&momentum) - skew(omega) * inertia);
        put(a, n, RATE, ANGLE, &rate_angle);
        put(a, n, RATE, RATE, &rate_rate);
        for (j, wheel) in model.wheels.iter().enumerate() {
            let axis = wheel.spin_axis_b.into_inner();
            let b = wheel.viscous_friction_n_m_s;
            let column = inverse * (axis * b - omega.cross(&(axis * wheel.spin_inertia_kg_m2)));
            for i in 0..3 {
                a[(RATE + i) * n + WHEEL + j] = column[i];
            }
            let row = WHEEL + j;
            a[row * n + row] -= b / wheel.spin_inertia_kg_m2;
            for m in 0..3 {
                for i in 0..3 {
                    a[row * n + ANGLE + i] -= axis[m] * rate_angle[(m, i)];
                    a[row * n + RATE + i] -= axis[m] * rate_rate[(m, i)];
                }
                for other in 0..self.wheels() {
                    a[row * n + WHEEL + other] -= axis[m] * a[(RATE + m) * n + WHEEL + other];
                }
            }
        }
        if self.settings.torque_walk > 0.0 {
            let torque = WHEEL + self.wheels();
            put(a, n, RATE, torque, inverse);
            for (j, wheel) in model.wheels.iter().enumerate() {
                let row = -(inverse.transpose() * wheel.spin_axis_b.into_inner());
                for i in 0..3 {
                    a[(WHEEL + j) * n + torque + i] = row[i];
                }
            }
        }
    }

    /// Transition over interval `k`: I + A h + (A h)^2 / 2.
    fn transition(&self, k: usize, a: &mut [f64], f: &mut [f64]) {
        let n = self.states();
        self.slope(k, a);
        let h = self.run.length(k);
        a.iter_mut().for_each(|x| *x *= h);
        f.fill(0.0);
        for i in 0..n {
            for m in 0..n {
                let x = a[i * n + m];
                if x == 0.0 {
                    continue;
                }
                f[i * n + m] += x;
                for j in 0..n {
                    f[i * n + j] += 0.5 * x * a[m * n + j];
                }
            }
            f[i * n + i] += 1.0;
        }
    }

    /// Adds the process noise of interval `k`.
    fn add_noise(&self, k: usize, p: &mut [f64]) {
        let n = self.states();
        let h = self.run.length(k);
        let model = self.mechanics.model();
        let s = &self.settings;
        let sensors = &model.sensors;
        if !self.run.clamped {
            let blind = h > 0.5
                || self.run.gyro.get(k).is_none_or(|g| g.count == 0.0) && h > 0.2
                || self.motion.q_mid.get(k).is_some_and(|q| self.mechanics.near_stop(q));
            let rate = if blind { 1.0 } else { s.rate_walk };
            let relative = |walk: f64, least: f64| walk.max(least).powi(2) * h;
            let axis = |i: usize| {
                // Free wheels keep their speed in space: what turns the body turns against them.
                let mut direction = vec![(RATE + i, 1.0)];
                direction
                    .extend(model.wheels.iter().enumerate().map(|(j, w)| (WHEEL + j, -w.spin_axis_b[i])));
                direction
            };
            for i in 0..3 {
                let direction = axis(i);
                for (a, x) in &direction {
                    for (b, y) in &direction {
                        p[a * n + b] += rate * rate * h * x * y;
                    }
                }
                p[(ANGLE + i) * (n + 1)] += 1e-14 * h;
                p[(GYRO_BIAS + i) * (n + 1)] += relative(sensors.gyro.errors.bias_walk[i], 1e-7);
                p[(ACCEL_BIAS + i) * (n + 1)] += relative(sensors.accelerometer.errors.bias_walk[i], 1e-6);
            }
            if s.torque_walk > 0.0 {
                let first = WHEEL + self.wheels();
                for i in 0..3 {
                    p[(first + i) * (n + 1)] += s.torque_walk.powi(2) * h;
                }
            }
        }
        for (j, wheel) in model.wheels.iter().enumerate() {
            let axis = wheel.spin_axis_b.into_inner();
            let speed = self.motion.wheel_mid.get(k).and_then(|w| w.get(j)).copied().unwrap_or(0.0);
            let near_zero = speed.abs() < (4.0 * self.run.noise.wheel).max(0.3);
            let at_limit = speed.abs() > 0.985 * wheel.max_speed_rad_s;
            let intensity = if !self.run.has_wheel_command {
                0.5 * wheel.max_torque_n_m
            } else if near_zero || at_limit {
                (2.0 * wheel.coulomb_friction_n_m).max(0.02 * wheel.max_torque_n_m)
            } else {
                // Just off standstill friction is still not what it is at speed.
                s.wheel_noise.max(2.0 * wheel.coulomb_friction_n_m * (0.3 / speed).powi(2))
            };
            // The motor's torque turns wheel and body against each other.
            let body =
                if self.run.clamped { Vector3::zeros() } else { -(self.mechanics.inverse_inertia * axis) };
            let own = 1.0 / wheel.spin_inertia_kg_m2;
            let mut direction = [0.0; 3 + whorl_dynamics::gyrostat::MAX_WHEELS];
            for i in 0..3 {
                direction[i] = body[i];
            }
            for (other, w) in model.wheels.iter().enumerate() {
                direction[3 + other] = -w.spin_axis_b.dot(&body) + if other == j { own } else { 0.0 };
            }
            let index = |i: usize| if i < 3 { RATE + i } else { WHEEL + i - 3 };
            let size = 3 + self.wheels();
            let variance = intensity * intensity * h;
            for a in 0..size {
                for b in 0..size {
                    p[index(a) * n + index(b)] += variance * direction[a] * direction[b];
                }
            }
        }
    }

    fn initial_covariance(&self) -> Vec<f64> {
        let n = self.states();
        let mut p = vec![0.0; n * n];
        let sensors = &self.mechanics.model().sensors;
        let clamped = self.run.clamped;
        for i in 0..3 {
            let slanted =
                |v: &crate::run::VectorRun| v.reference_world.z.abs() < 0.98 * v.reference_world.norm();
            let heading = i == 2 && !self.run.vectors.iter().any(slanted);
            let angle = if clamped {
                1e-9
            } else if heading {
                1e-5
            } else {
                0.2
            };
            p[(ANGLE + i) * (n + 1)] = angle * angle;
            p[(RATE + i) * (n + 1)] = if clamped { 1e-20 } else { 0.25 };
            let bias = (3.0 * sensors.gyro.errors.bias_turn_on_stddev[i]).max(0.02);
            p[(GYRO_BIAS + i) * (n + 1)] = bias * bias;
            let bias = sensors.accelerometer.errors.bias_turn_on_stddev[i].max(1e-4);
            p[(ACCEL_BIAS + i) * (n + 1)] = bias * bias;
        }
        let wheel = if self.run.wheel_speed.iter().any(|s| s.1 > 0.0) { 5.0 } else { 50.0 };
        for j in 0..self.wheels() {
            p[(WHEEL + j) * (n + 1)] = wheel * wheel;
        }
        if self.settings.torque_walk > 0.0 {
            for i in 0..3 {
                p[(WHEEL + self.wheels() + i) * (n + 1)] = 0.1 * 0.1;
            }
        }
        p
    }

    /// Measurements at node `k`.
    fn rows(&self, k: usize, rows: &mut Vec<Row>) {
        rows.clear();
        let n = self.states();
        let (run, noise) = (self.run, &self.run.noise);
        let mut push = |channel, residual, variance, parts: &[(usize, f64)]| {
            let mut h = vec![0.0; n];
            for (index, value) in parts {
                h[*index] += value;
            }
            rows.push(Row { channel, residual, variance, h });
        };
        if !run.clamped {
            let (Some(q), Some(omega)) = (self.motion.q.get(k), self.motion.omega.get(k)) else { return };
            let sensors = &self.mechanics.model().sensors;
            if let (Some(mean), Some(predicted)) = (run.gyro.get(k), self.prediction.gyro.get(k))
                && mean.count > 0.0
            {
                for i in 0..3 {
                    let scale = 1.0 + sensors.gyro.errors.scale[i];
                    let parts = [(RATE + i, scale), (GYRO_BIAS + i, 1.0)];
                    let variance = noise.gyro[i].powi(2) / mean.count;
                    push(i, mean.value[i] - predicted[i], variance, &parts);
                }
            }
            let up = vertical_b(q);
            if let (Some(mean), Some(predicted)) = (run.accel.get(k), self.prediction.accel.get(k))
                && mean.count > 0.0
            {
                let r = sensors.accelerometer.lever_arm_b_m;
                let by_angle = skew(&up) * GRAVITY_M_S2;
                // d/dw of w x (w x r) = (w . r) I + w r^T - 2 r w^T.
                let by_rate =
                    Matrix3::identity() * omega.dot(&r) + omega * r.transpose() - r * omega.transpose() * 2.0;
                for i in 0..3 {
                    let mut parts = [(0, 0.0); 7];
                    for j in 0..3 {
                        parts[j] = (ANGLE + j, by_angle[(i, j)]);
                        parts[3 + j] = (RATE + j, by_rate[(i, j)]);
                    }
                    parts[6] = (ACCEL_BIAS + i, 1.0);
                    let variance = noise.accel[i].powi(2) / mean.count;
                    push(3 + i, mean.value[i] - predicted[i], variance, &parts);
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
                    let variance = noise.vector_rad.powi(2) / mean.count;
                    push(6 + 2 * v + axis, difference.dot(&e), variance, &parts);
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
                push(6 + 2 * run.vectors.len() + j, residual, variance, &[(WHEEL + j, 1.0)]);
            }
        }
    }

    /// What the model adds to the trajectory over interval `k`: prediction less trajectory.
    fn defect(&self, k: usize, d: &mut [f64]) {
        d.fill(0.0);
        let h = self.run.length(k);
        let motion = self.motion;
        let (Some(acceleration), Some(wheel_acceleration)) =
            (self.prediction.omega_dot.get(k), self.prediction.wheel_dot.get(k))
        else {
            return;
        };
        if !self.run.clamped
            && let (Some(q0), Some(q1), Some(w0), Some(w1), Some(middle)) = (
                motion.q.get(k),
                motion.q.get(k + 1),
                motion.omega.get(k),
                motion.omega.get(k + 1),
                motion.omega_mid.get(k),
            )
        {
            let predicted = q0 * whorl_math::quaternion_exp(&(middle * h));
            let angle = whorl_math::rotation_vector(&(q1.inverse() * predicted));
            let rate = acceleration * h - (w1 - w0);
            for i in 0..3 {
                // The model's mean rate differs from the trajectory's by half of what it adds.
                d[ANGLE + i] = angle[i] + 0.5 * h * rate[i];
                d[RATE + i] = rate[i];
            }
        }
        if let (Some(s0), Some(s1)) = (motion.wheel.get(k), motion.wheel.get(k + 1)) {
            for j in 0..self.wheels() {
                d[WHEEL + j] = wheel_acceleration[j] * h - (s1[j] - s0[j]);
            }
        }
    }

    /// Runs the filter; `smooth` also runs back (modified Bryson-Frazier smoother).
    pub fn filter(&self, keep_gains: bool, smooth: bool) -> (Gains, Option<Smoothed>) {
        let n = self.states();
        let nodes = self.run.nodes();
        let mut gains = Gains { n, ..Gains::default() };
        let (mut p, mut x) = (self.initial_covariance(), vec![0.0; n]);
        let (mut a, mut f, mut fp) = (vec![0.0; n * n], vec![0.0; n * n], vec![0.0; n * n]);
        let (mut d, mut ph) = (vec![0.0; n], vec![0.0; n]);
        let mut rows: Vec<Row> = Vec::new();
        let mut predicted: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        let keep = keep_gains || smooth;
        for k in 0..nodes {
            gains.first_row.push(gains.whitened.len());
            if smooth {
                predicted.push((x.clone(), p.clone()));
            }
            self.rows(k, &mut rows);
            for row in &rows {
                for i in 0..n {
                    ph[i] = (0..n).map(|j| p[i * n + j] * row.h[j]).sum();
                }
                let s = row.variance + row.h.iter().zip(&ph).map(|(h, v)| h * v).sum::<f64>();
                let innovation = row.residual - row.h.iter().zip(&x).map(|(h, v)| h * v).sum::<f64>();
                for i in 0..n {
                    x[i] += ph[i] / s * innovation;
                }
                for i in 0..n {
                    let gain = ph[i] / s;
                    if gain == 0.0 {
                        continue;
                    }
                    for j in 0..n {
                        p[i * n + j] -= gain * ph[j];
                    }
                }
                gains.whitened.push(innovation / s.sqrt());
                gains.log_likelihood -= 0.5 * (innovation * innovation / s + s.ln());
                if keep {
                    gains.channel.push(row.channel as u8);
                    gains.node.push(k as u32);
                    gains.inverse_stddev.push(1.0 / s.sqrt());
                    gains.h.extend_from_slice(&row.h);
                    gains.gain.extend(ph.iter().map(|v| v / s));
                }
            }
            if k + 1 < nodes {
                self.transition(k, &mut a, &mut f);
                self.defect(k, &mut d);
                let moved: Vec<f64> =
                    (0..n).map(|i| (0..n).map(|j| f[i * n + j] * x[j]).sum::<f64>() + d[i]).collect();
                x = moved;
                multiply(&f, &p, &mut fp, n);
                multiply_transposed(&fp, &f, &mut p, n);
                self.add_noise(k, &mut p);
                for i in 0..n {
                    for j in 0..i {
                        let mean = 0.5 * (p[i * n + j] + p[j * n + i]);
                        p[i * n + j] = mean;
                        p[j * n + i] = mean;
                    }
                }
                if keep {
                    gains.transition.extend_from_slice(&f);
                }
            }
        }
        gains.first_row.push(gains.whitened.len());
        let smoothed = smooth.then(|| self.smooth(&gains, &predicted));
        (gains, smoothed)
    }

    fn smooth(&self, gains: &Gains, predicted: &[(Vec<f64>, Vec<f64>)]) -> Smoothed {
        let n = gains.n;
        let nodes = self.run.nodes();
        let with_torque = self.settings.torque_walk > 0.0;
        let torque = WHEEL + self.wheels();
        let mut smoothed = Smoothed { state: vec![0.0; nodes * n], torque_variance: Vec::new() };
        if with_torque {
            smoothed.torque_variance = vec![0.0; nodes * 3];
        }
        let mut lambda = vec![0.0; n];
        let mut big = vec![0.0; n * n];
        let mut work = vec![0.0; n * n];
        let mut work2 = vec![0.0; n * n];
        for k in (0..nodes).rev() {
            if k + 1 < nodes {
                let f = &gains.transition[k * n * n..(k + 1) * n * n];
                let back: Vec<f64> = (0..n).map(|i| (0..n).map(|j| f[j * n + i] * lambda[j]).sum()).collect();
                lambda = back;
                if with_torque {
                    // F^T L F
                    multiply(&big, f, &mut work, n);
                    transposed_multiply(f, &work, &mut big, n);
                }
            }
            for row in (gains.first_row[k]..gains.first_row[k + 1]).rev() {
                let h = &gains.h[row * n..(row + 1) * n];
                let gain = &gains.gain[row * n..(row + 1) * n];
                let inverse = gains.inverse_stddev[row];
                let along: f64 = gain.iter().zip(&lambda).map(|(g, l)| g * l).sum();
                let pull = gains.whitened[row] * inverse + along;
                if with_torque {
                    // (I - K H)^T L (I - K H) + H^T H / S
                    let lk: Vec<f64> =
                        (0..n).map(|i| (0..n).map(|j| big[i * n + j] * gain[j]).sum()).collect();
                    let klk: f64 = gain.iter().zip(&lk).map(|(g, l)| g * l).sum();
                    let weight = klk + inverse * inverse;
                    for i in 0..n {
                        for j in 0..n {
                            big[i * n + j] += weight * h[i] * h[j] - h[i] * lk[j] - lk[i] * h[j];
                        }
                    }
                }
                for i in 0..n {
                    lambda[i] -= h[i] * pull;
                }
            }
            let (x, p) = &predicted[k];
            for i in 0..n {
                let correction: f64 = (0..n).map(|j| p[i * n + j] * lambda[j]).sum();
                smoothed.state[k * n + i] = x[i] - correction;
            }
            if with_torque {
                multiply(p, &big, &mut work, n);
                multiply(&work, p, &mut work2, n);
                for i in 0..3 {
                    let at = (torque + i) * (n + 1);
                    smoothed.torque_variance[k * 3 + i] = (p[at] - work2[at]).max(0.0);
                }
            }
        }
        smoothed
    }
}

fn multiply(a: &[f64], b: &[f64], c: &mut [f64], n: usize) {
    c.fill(0.0);
    for i in 0..n {
        for m in 0..n {
            let x = a[i * n + m];
            if x != 0.0 {
                for j in 0..n {
                    c[i * n + j] += x * b[m * n + j];
                }
            }
        }
    }
}

/// c = a b^T
fn multiply_transposed(a: &[f64], b: &[f64], c: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..n {
            c[i * n + j] = (0..n).map(|m| a[i * n + m] * b[j * n + m]).sum();
        }
    }
}

/// c = a^T b
fn transposed_multiply(a: &[f64], b: &[f64], c: &mut [f64], n: usize) {
    c.fill(0.0);
    for m in 0..n {
        for i in 0..n {
            let x = a[m * n + i];
            if x != 0.0 {
                for j in 0..n {
                    c[i * n + j] += x * b[m * n + j];
                }
            }
        }
    }
}
