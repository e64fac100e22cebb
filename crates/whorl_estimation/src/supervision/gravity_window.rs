//! Gravity from the accelerometer, averaged in a frame that does not turn with the body.
//!
//! An accelerometer at `r` from the pivot moves with `v = R (omega x r)` in world axes, and
//! eq. (4.40) in world axes is `R y = dv/dt + g k`: the lever-arm terms are a time derivative.
//! Averaged over a window of length T,
//!
//! `mean(R y) = g k + (v(end) - v(begin)) / T`,
//!
//! so angular acceleration and centripetal terms need no differentiated gyro signal: two rates
//! suffice, and their noise falls with 1/T.

use crate::kernels::attitude_bias::covariance::Measurement;
use crate::parameters::Parameters;
use crate::residual::direction_residual;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, UnitQuaternion, Vector3};
use whorl_math::{skew, unit_or};

/// The running integrals of one window, in the frame of the estimate ("carried").
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GravityWindow {
    /// Integral of the specific force \[m/s\], trapezoidal.
    force: Vector3<f64>,
    /// The latest specific force \[m/s^2\].
    latest_force: Vector3<f64>,
    /// Integral of the rotation matrix since the beginning \[s\]: the sensitivity of the rotation to a bias error.
    lever: Matrix3<f64>,
    /// Integral of `lever` \[s^2\].
    lever_integral: Matrix3<f64>,
    rotation_begin: Matrix3<f64>,
    velocity_begin: Vector3<f64>,
    elapsed_s: f64,
    intervals: u32,
}

impl GravityWindow {
    /// Begins at a sample: its specific force and rate (bias removed) in body axes.
    pub(crate) fn new(
        rotation: &Matrix3<f64>,
        force_b: &Vector3<f64>,
        omega: &Vector3<f64>,
        parameters: &Parameters,
    ) -> Self {
        Self {
            force: Vector3::zeros(),
            latest_force: rotation * force_b,
            lever: Matrix3::zeros(),
            lever_integral: Matrix3::zeros(),
            rotation_begin: *rotation,
            velocity_begin: rotation * omega.cross(&parameters.accelerometer_position_b_m),
            elapsed_s: 0.0,
            intervals: 0,
        }
    }

    /// The next sample, `dt_s` later; `mean_rotation` is that of the interval.
    pub(crate) fn add(
        &mut self,
        rotation: &Matrix3<f64>,
        mean_rotation: &Matrix3<f64>,
        force_b: &Vector3<f64>,
        dt_s: f64,
    ) {
        let force = rotation * force_b;
        self.force += (self.latest_force + force) * (0.5 * dt_s);
        self.latest_force = force;
        let step = mean_rotation * dt_s;
        self.lever_integral += (self.lever + step * 0.5) * dt_s;
        self.lever += step;
        self.elapsed_s += dt_s;
        self.intervals += 1;
    }

    /// An interval whose sample was refused: gravity goes on in the carried frame.
    pub(crate) fn hold(&mut self, mean_rotation: &Matrix3<f64>, dt_s: f64) {
        self.force += self.latest_force * dt_s;
        let step = mean_rotation * dt_s;
        self.lever_integral += (self.lever + step * 0.5) * dt_s;
        self.lever += step;
        self.elapsed_s += dt_s;
    }

    pub(crate) fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    pub(crate) fn intervals(&self) -> u32 {
        self.intervals
    }

    pub(crate) fn lever(&self) -> &Matrix3<f64> {
        &self.lever
    }

    /// The carried frame was turned and the bias changed by a correction: what was integrated with
    /// the old bias is moved to where the new one would have put it, as seen from now.
    pub(crate) fn correct(
        &mut self,
        turn: &UnitQuaternion<f64>,
        bias_change: &Vector3<f64>,
        parameters: &Parameters,
    ) {
        let begin_change = self.rotation_begin * bias_change.cross(&parameters.accelerometer_position_b_m);
        if self.elapsed_s > 0.0 {
            let since = self.lever - self.lever_integral / self.elapsed_s;
            self.force += (since * bias_change).cross(&self.force);
        }
        self.force = turn * self.force;
        self.latest_force = turn * self.latest_force;
        self.velocity_begin = turn * (self.velocity_begin - begin_change);
    }

    /// Changes to another carried frame.
    pub(crate) fn change_frame(&mut self, turn: &Matrix3<f64>) {
        self.force = turn * self.force;
        self.latest_force = turn * self.latest_force;
        self.velocity_begin = turn * self.velocity_begin;
        self.lever = turn * self.lever;
        self.lever_integral = turn * self.lever_integral;
        self.rotation_begin = turn * self.rotation_begin;
    }

    /// Mean specific force without its lever-arm part, carried frame \[m/s^2\]; `rotation` and
    /// `omega` are the current ones. Zero if nothing was added.
    pub(crate) fn mean_force(
        &self,
        rotation: &Matrix3<f64>,
        omega: &Vector3<f64>,
        parameters: &Parameters,
    ) -> Vector3<f64> {
        if self.elapsed_s <= 0.0 {
            return Vector3::zeros();
        }
        let velocity = rotation * omega.cross(&parameters.accelerometer_position_b_m);
        (self.force - (velocity - self.velocity_begin)) / self.elapsed_s
    }

    /// The window as a measurement of the attitude now, the carried frame being the world's.
    pub(crate) fn vertical(
        &self,
        rotation: &Matrix3<f64>,
        omega: &Vector3<f64>,
        parameters: &Parameters,
    ) -> Measurement {
        let gravity = parameters.gravity_m_s2;
        let mean = self.mean_force(rotation, omega, parameters);
        // Each sample's length was checked against gravity, so the mean is not near zero.
        let direction = unit_or(mean, Vector3::z_axis());
        let residual = direction_residual(&direction, &Vector3::z_axis());
        let (span_s, count) = (self.elapsed_s, f64::from(self.intervals));
        let scale = 1.0 / (gravity * span_s);

        // The mean error over the window is the current one, less the rotation by the bias error since then.
        let since = self.lever - self.lever_integral / span_s;
        let mut bias = since.fixed_rows::<2>(0).transpose();
        let noise_m_s2 = parameters.accelerometer_noise_m_s2.powi(2) / count
            + (parameters.accelerometer_velocity_sigma_m_s / span_s).powi(2);
        let lever_b = &parameters.accelerometer_position_b_m;
        let mut noise = Matrix2::zeros();
        if *lever_b != Vector3::zeros() {
            // The velocity difference is wrong by (R2 - R1) [r x] bias_error; a force n looks like
            // the rotation n x k / g. This is the bias block of eq. (4.72), integrated.
            let slope = (rotation - self.rotation_begin) * skew(lever_b) * scale;
            bias += Matrix3x2::from_columns(&[slope.row(1).transpose(), -slope.row(0).transpose()]);
            // Gyro noise at the ends: omega noise s gives v a covariance s^2 (r^2 1 - r r^T). The end
            // of a window is the beginning of the next, where the same noise returns with the
            // opposite sign: counted once per window, not twice.
            let sample_variance = parameters.gyro_noise_rad_s_sqrt_hz.powi(2) * count / span_s;
            let lever_w = rotation * lever_b;
            let (x, y, squared) = (lever_w.x, lever_w.y, lever_w.norm_squared());
            noise = Matrix2::new(squared - y * y, x * y, x * y, squared - x * x)
                * (sample_variance * scale * scale);
        }
        // The mean error over the window lacks what gyro noise added since: with w(t) a random walk
        // of variance q T over the window, its mean distance to the end has variance
        // q T / 3 and covariance q T / 2 with the end.
        let gyro_variance = parameters.gyro_noise_rad_s_sqrt_hz.powi(2) * span_s;
        let variance = noise_m_s2 / (gravity * gravity) + gyro_variance / 3.0;
        noise.m11 += variance;
        noise.m22 += variance;
        Measurement {
            innovation: residual.xy(),
            attitude: Matrix3x2::identity(),
            bias: Some(bias),
            noise,
            lag_variance: 0.5 * gyro_variance,
        }
    }
}

/// A single sample at the centre of rotation as a measurement of the attitude now.
pub(crate) fn vertical_of_sample(
    rotation: &Matrix3<f64>,
    force_b: &Vector3<f64>,
    parameters: &Parameters,
) -> Measurement {
    let direction = unit_or(rotation * force_b, Vector3::z_axis());
    let noise_rad = parameters.accelerometer_noise_m_s2 / parameters.gravity_m_s2;
    Measurement {
        innovation: direction_residual(&direction, &Vector3::z_axis()).xy(),
        attitude: Matrix3x2::identity(),
        bias: None,
        noise: Matrix2::identity() * (noise_rad * noise_rad),
        lag_variance: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::{quaternion_exp, rotation_vector};

    /// Swinging motion with closed-form rate and acceleration: R = Rz(a(t)) Rx(b(t)).
    fn sample(t: f64, lever: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>, Vector3<f64>) {
        let attitude = |t: f64| {
            quaternion_exp(&(Vector3::z() * (0.4 * (1.5 * t).sin())))
                * quaternion_exp(&(Vector3::x() * (0.3 * (2.0 * t).cos())))
        };
        let d = 1e-4;
        let rate = |t: f64| rotation_vector(&(attitude(t - d).inverse() * attitude(t + d))) / (2.0 * d);
        let (omega, acceleration) = (rate(t), (rate(t + d) - rate(t - d)) / (2.0 * d));
        let rotation = *attitude(t).to_rotation_matrix().matrix();
        let force = rotation.transpose() * Vector3::new(0.0, 0.0, 9.81)
            + acceleration.cross(lever)
            + omega.cross(&omega.cross(lever));
        (rotation, omega, force)
    }

    fn window(parameters: &Parameters, omega_error: &Vector3<f64>) -> Measurement {
        let lever = &parameters.accelerometer_position_b_m;
        let (mut rotation, omega, force) = sample(0.3, lever);
        let mut window = GravityWindow::new(&rotation, &force, &(omega + omega_error), parameters);
        let mut last = omega;
        for step in 1..=200 {
            let (next, omega, force) = sample(0.3 + f64::from(step) * 1e-3, lever);
            window.add(&next, &((rotation + next) * 0.5), &force, 1e-3);
            (rotation, last) = (next, omega);
        }
        window.vertical(&rotation, &(last + omega_error), parameters)
    }

    #[test]
    fn lever_arm_terms_cancel_exactly() {
        let mut parameters = Parameters::motion_pak_ii();
        parameters.accelerometer_position_b_m = Vector3::new(0.3, -0.2, 0.4);
        let vertical = window(&parameters, &Vector3::zeros());
        // Without the correction the innovation is some 0.02 rad.
        assert!(vertical.innovation.norm() < 2e-6, "{}", vertical.innovation);
    }

    #[test]
    fn lever_arm_bias_sensitivity_is_the_derivative() {
        let mut parameters = Parameters::motion_pak_ii();
        parameters.accelerometer_position_b_m = Vector3::new(0.3, -0.2, 0.4);
        let with_lever = window(&parameters, &Vector3::zeros());
        let mut without = parameters;
        without.accelerometer_position_b_m = Vector3::zeros();
        let lever_part =
            with_lever.bias.expect("has one") - window(&without, &Vector3::zeros()).bias.expect("has one");
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            // A bias estimate too low by d makes the rate too high by d.
            let step = 1e-4;
            let high = window(&parameters, &(axis * step)).innovation;
            let low = window(&parameters, &(axis * -step)).innovation;
            let numeric = (high - low) / (2.0 * step);
            assert!((numeric - lever_part.tr_mul(&axis)).norm() < 1e-6, "{axis} {numeric}");
        }
    }
}
