//! The error dynamics, linearised interval by interval.

use nalgebra::Matrix3;
use whorl_math::{skew, vertical_b};

use super::{ANGLE, RATE, System, WHEEL};

fn put(matrix: &mut [f64], n: usize, row: usize, column: usize, block: &Matrix3<f64>) {
    for i in 0..3 {
        for j in 0..3 {
            matrix[(row + i) * n + column + j] = block[(i, j)];
        }
    }
}

impl System<'_> {
    /// Continuous-time matrix of the error dynamics in the middle of interval `k`.
    fn slope(&self, k: usize, a: &mut [f64]) {
        let n = self.states();
        a.fill(0.0);
        let model = self.mechanics.model();
        if self.run.clamped {
            for (j, wheel) in model.wheels().iter().enumerate() {
                a[(WHEEL + j) * n + WHEEL + j] = -wheel.viscous_friction_n_m_s / wheel.spin_inertia_kg_m2;
            }
            return;
        }
        let (Some(q), Some(omega), Some(speed)) =
            (self.motion.q_mid.get(k), self.motion.omega_mid.get(k), self.motion.wheel_mid.get(k))
        else {
            return;
        };
        let up = vertical_b(q);
        let mut offset = *model.mass_properties.gravity_offset_b_n_m();
        offset += self.run.ballast_moment.get(k).copied().unwrap_or_default();
        put(a, n, ANGLE, ANGLE, &-skew(omega));
        put(a, n, ANGLE, RATE, &Matrix3::identity());
        let gyrostat = &self.mechanics.gyrostat;
        let momentum = gyrostat.momentum_b_n_m_s(omega, &speed[..self.wheels()])
            + gyrostat.gyro_momentum_b_n_m_s(&self.run.environment(model, k));
        let mut rate = gyrostat.rate_equation().linearised(omega, &momentum, &offset, &up);
        if let Some(slope) = self.prediction.torque_slope.get(k) {
            let damping = rate.by_torque * slope.by_rate;
            // What settles within an interval does no more than settle.
            rate.by_rate += damping / (damping.norm() * self.run.length(k)).max(1.0);
            rate.by_attitude += rate.by_torque * slope.by_attitude;
        }
        put(a, n, RATE, ANGLE, &rate.by_attitude);
        put(a, n, RATE, RATE, &rate.by_rate);
        for (j, wheel) in model.wheels().iter().enumerate() {
            let axis = wheel.spin_axis_b.into_inner();
            let b = wheel.viscous_friction_n_m_s;
            let column =
                rate.by_torque * (axis * b) + rate.by_wheel_momentum * (axis * wheel.spin_inertia_kg_m2);
            for i in 0..3 {
                a[(RATE + i) * n + WHEEL + j] = column[i];
            }
            let row = WHEEL + j;
            a[row * n + row] -= b / wheel.spin_inertia_kg_m2;
            for m in 0..3 {
                for i in 0..3 {
                    a[row * n + ANGLE + i] -= axis[m] * rate.by_attitude[(m, i)];
                    a[row * n + RATE + i] -= axis[m] * rate.by_rate[(m, i)];
                }
                for other in 0..self.wheels() {
                    a[row * n + WHEEL + other] -= axis[m] * a[(RATE + m) * n + WHEEL + other];
                }
            }
        }
        if self.settings.has_torque() {
            let torque = WHEEL + self.wheels();
            put(a, n, RATE, torque, &rate.by_torque);
            for i in torque..torque + 3 {
                a[i * n + i] = -self.settings.torque_decay_per_s();
            }
            for (j, wheel) in model.wheels().iter().enumerate() {
                let row = -(rate.by_torque.transpose() * wheel.spin_axis_b.into_inner());
                for i in 0..3 {
                    a[(WHEEL + j) * n + torque + i] = row[i];
                }
            }
        }
    }

    /// Transition over interval `k`, I + A h + (A h)^2 / 2, into `f`; `a` is room to work in.
    pub(super) fn transition(&self, k: usize, a: &mut [f64], f: &mut [f64]) {
        let n = self.states();
        self.slope(k, a);
        let h = self.run.length(k);
        a.iter_mut().for_each(|x| *x *= h);
        f.fill(0.0);
        for (i, (f_row, a_row)) in f.chunks_exact_mut(n).zip(a.chunks_exact(n)).enumerate() {
            for (m, x) in a_row.iter().enumerate() {
                if *x == 0.0 {
                    continue;
                }
                f_row[m] += x;
                for (slot, y) in f_row.iter_mut().zip(&a[m * n..(m + 1) * n]) {
                    *slot += 0.5 * x * y;
                }
            }
            f_row[i] += 1.0;
        }
    }

    /// What the model adds to the trajectory over interval `k`: prediction less trajectory.
    pub(super) fn defect(&self, k: usize, d: &mut [f64]) {
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
}
