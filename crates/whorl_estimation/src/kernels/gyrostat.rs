//! Attitude-error / momentum filter of a gyrostat: it uses all measurements and the model of the platform.
//!
//! The filter of J. L. Schwartz's section 4.5.3 (eqs. 4.61-4.68) carried over to momentum wheels, which
//! the dissertation leaves open ("we must derive a new filter using the gyrostat equations"). Two
//! changes of variable make it short and well conditioned:
//!
//! - the rate is replaced by the total angular momentum in *world* axes, `H = R (I omega + h)`, with h
//!   the wheels' momentum by their tachometers. Then `dH/dt = R (r_g x m g R^T(-k) + d + jets)` holds no
//!   gyroscopic term, a wheel's torque and friction drop out, and `omega = I^-1 (R^T H - h)` is an output;
//! - the attitude error is a rotation vector in world axes, `R_true = exp(delta) R`, as in [`crate::AttitudeBiasEstimator`].
//!
//! Model errors are states: gyro bias b, a torque d fixed in the body (balance, leaks), and
//! the accelerometer's bias c, which the vector sensor and rotations of the platform make observable. The accelerometer
//! is used as in eq. (4.40) with the model's own angular acceleration.

use super::kernel::{DirectionMeasurement, FilterStep, Kernel, Solution, Update};
use crate::body::BodyModel;
use crate::parameters::Parameters;
use crate::residual::{across, direction_residual};
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, UnitQuaternion, Vector3};
use whorl_dynamics::gyrostat::RateEquation;
use whorl_dynamics::gyrostat::equation::gravity_torque_n_m;
use whorl_math::covariance::{correct_scalar, symmetrise};
use whorl_math::{quaternion_exp, skew, unit};

/// Attitude error, momentum error (world axes); gyro bias, torque, accelerometer bias (body axes).
const STATES: usize = 15;
const ATTITUDE: usize = 0;
const MOMENTUM: usize = 3;
const GYRO_BIAS: usize = 6;
const TORQUE: usize = 9;
const FORCE_BIAS: usize = 12;

type Covariance = SMatrix<f64, STATES, STATES>;
type Row = SVector<f64, STATES>;

/// The filter's state.
#[derive(Clone, Debug, PartialEq)]
pub struct GyrostatFilter {
    parameters: Parameters,
    body: BodyModel,
    equation: RateEquation,
    q_world_body: UnitQuaternion<f64>,
    momentum_w_n_m_s: Vector3<f64>,
    gyro_bias_rad_s: Vector3<f64>,
    torque_b_n_m: Vector3<f64>,
    force_bias_m_s2: Vector3<f64>,
    /// Output: body rate [rad/s].
    omega_rad_s: Vector3<f64>,
    wheel_momentum_b_n_m_s: Vector3<f64>,
    covariance: Covariance,
}

/// First-order transition of one step, in 3x3 blocks; the rest is the identity.
struct Transition {
    attitude_attitude: Matrix3<f64>,
    attitude_momentum: Matrix3<f64>,
    momentum_attitude: Matrix3<f64>,
    momentum_torque: Matrix3<f64>,
}

fn block(matrix: &Covariance, row: usize, column: usize) -> Matrix3<f64> {
    matrix.fixed_view::<3, 3>(row, column).into()
}

impl GyrostatFilter {
    /// Rate that the momentum implies, body axes.
    fn rate(&self, rotation: &Matrix3<f64>, wheel_momentum_b: &Vector3<f64>) -> Vector3<f64> {
        self.equation.rate_b_rad_s(&rotation.tr_mul(&self.momentum_w_n_m_s), wheel_momentum_b)
    }

    /// Moves the mean; returns the transition of the error and the rotation in the middle of the step.
    fn predict(&mut self, step: &FilterStep) -> (Transition, Matrix3<f64>) {
        let dt_s = step.dt_s;
        let before = *self.q_world_body.to_rotation_matrix().matrix();
        let half = self.q_world_body * quaternion_exp(&(self.omega_rad_s * (0.5 * dt_s)));
        let middle = *half.to_rotation_matrix().matrix();
        let (offset_w, up) = (middle * self.body.gravity_offset_b_n_m, Vector3::z());
        let torque_w = gravity_torque_n_m(&offset_w, &up) + middle * self.torque_b_n_m;
        let impulse_w = middle * step.jet_impulse_b_n_m_s;
        self.momentum_w_n_m_s += torque_w * dt_s + impulse_w;
        let predicted = self.q_world_body * quaternion_exp(&(self.omega_rad_s * dt_s));
        let omega = self.rate(predicted.to_rotation_matrix().matrix(), &step.wheel_momentum_b_n_m_s);
        self.q_world_body *= quaternion_exp(&((self.omega_rad_s + omega) * (0.5 * dt_s)));
        self.q_world_body.renormalize_fast();
        let after = *self.q_world_body.to_rotation_matrix().matrix();
        self.omega_rad_s = self.rate(&after, &step.wheel_momentum_b_n_m_s);
        self.wheel_momentum_b_n_m_s = step.wheel_momentum_b_n_m_s;
        let mean = (before + after) * 0.5;
        let mobility = mean * self.equation.rate_by_momentum() * mean.transpose() * dt_s;
        let known_w = middle * self.torque_b_n_m * dt_s + impulse_w;
        let transition = Transition {
            attitude_attitude: mobility * skew(&self.momentum_w_n_m_s),
            attitude_momentum: mobility,
            // d(-o x up) with do = delta x o, and d(R d) = delta x R d.
            momentum_attitude: -skew(&up) * skew(&offset_w) * dt_s - skew(&known_w),
            momentum_torque: middle * dt_s,
        };
        (transition, middle)
    }

    /// `P <- F P F^T + Q`.
    fn propagate_covariance(
        &mut self,
        transition: &Transition,
        step: &FilterStep,
        omega_before: &Vector3<f64>,
        middle: &Matrix3<f64>,
    ) {
        let p = &mut self.covariance;
        // F P, column by column: the new attitude row needs the old momentum row.
        for column in 0..STATES {
            let take =
                |row: usize| Vector3::new(p[(row, column)], p[(row + 1, column)], p[(row + 2, column)]);
            let (a, h, d) = (take(ATTITUDE), take(MOMENTUM), take(TORQUE));
            let new_a = a + transition.attitude_attitude * a + transition.attitude_momentum * h;
            let new_h = h + transition.momentum_attitude * a + transition.momentum_torque * d;
            for axis in 0..3 {
                p[(ATTITUDE + axis, column)] = new_a[axis];
                p[(MOMENTUM + axis, column)] = new_h[axis];
            }
        }
        // (F P) F^T, three columns at a time.
        let a = p.fixed_columns::<3>(ATTITUDE).into_owned();
        let h = p.fixed_columns::<3>(MOMENTUM).into_owned();
        let d = p.fixed_columns::<3>(TORQUE).into_owned();
        let new_a =
            a + a * transition.attitude_attitude.transpose() + h * transition.attitude_momentum.transpose();
        let new_h =
            h + a * transition.momentum_attitude.transpose() + d * transition.momentum_torque.transpose();
        p.fixed_columns_mut::<3>(ATTITUDE).copy_from(&new_a);
        p.fixed_columns_mut::<3>(MOMENTUM).copy_from(&new_h);

        let (body, dt_s) = (&self.body, step.dt_s);
        // White noise of the tachometers turns the attitude: one sample's worth per step.
        let wheel = transition.attitude_momentum * body.wheel_momentum_noise_n_m_s;
        let attitude = wheel * wheel.transpose();
        let jets = middle * step.jet_impulse_b_n_m_s * body.jet_relative_sigma;
        // A wrong inertia makes a rate look like momentum: 2 omega d(omega), summed while the rate builds
        // up, is its square.
        let inertia = &body.inertia_kg_m2;
        let built_up =
            (inertia * self.omega_rad_s).norm() * (inertia * (self.omega_rad_s - omega_before)).norm();
        let momentum = Matrix3::identity()
            * (body.torque_noise_n_m_sqrt_hz.powi(2) * dt_s
                + 2.0 * built_up * body.inertia_relative_sigma.powi(2))
            + jets * jets.transpose();
        add_block(p, ATTITUDE, &attitude);
        add_block(p, MOMENTUM, &momentum);
        let turned = 2.0 * self.omega_rad_s.norm() * (self.omega_rad_s - omega_before).norm();
        let walk = self.parameters.gyro_bias_walk_rad_s2_sqrt_hz.powi(2) * dt_s
            + body.gyro_scale_sigma.powi(2) * turned;
        add_block(p, GYRO_BIAS, &(Matrix3::identity() * walk));
        add_block(p, TORQUE, &(Matrix3::identity() * (body.torque_walk_n_m_sqrt_s.powi(2) * dt_s)));
        let walk = body.accelerometer_bias_walk_m_s2_sqrt_s.powi(2) * dt_s;
        add_block(p, FORCE_BIAS, &(Matrix3::identity() * walk));
    }

    /// One scalar measurement `z = h . error + noise`; returns its normalised innovation squared.
    fn update_scalar(&mut self, h: &Row, on: &Row, z: f64, variance: f64, correction: &mut Row) -> f64 {
        let s = h.dot(on) + variance;
        // The later scalars of a sample are applied to the estimate corrected by the earlier ones.
        let z = z - h.dot(correction);
        let gain = correct_scalar(&mut self.covariance, on, s);
        *correction += gain * z;
        z * z / s
    }

    /// Moves the estimate by the accumulated correction; the rate follows from momentum and attitude.
    fn apply(&mut self, correction: &Row) {
        let part = |start: usize| Vector3::from(correction.fixed_rows::<3>(start));
        self.q_world_body = quaternion_exp(&part(ATTITUDE)) * self.q_world_body;
        self.q_world_body.renormalize_fast();
        self.momentum_w_n_m_s += part(MOMENTUM);
        self.gyro_bias_rad_s += part(GYRO_BIAS);
        self.torque_b_n_m += part(TORQUE);
        self.force_bias_m_s2 += part(FORCE_BIAS);
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        self.omega_rad_s = self.rate(&rotation, &self.wheel_momentum_b_n_m_s);
    }

    /// Sensitivity of the rate, one row per body axis, to attitude and momentum errors.
    fn rate_sensitivity(&self, rotation: &Matrix3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
        let to_momentum = self.equation.rate_by_momentum() * rotation.transpose();
        (to_momentum * skew(&self.momentum_w_n_m_s), to_momentum)
    }

    fn use_gyro(&mut self, gyro_rad_s: &Vector3<f64>, dt_s: f64) {
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        let (to_attitude, to_momentum) = self.rate_sensitivity(&rotation);
        let innovation = gyro_rad_s - self.omega_rad_s - self.gyro_bias_rad_s;
        let variance = self.parameters.gyro_noise_rad_s_sqrt_hz.powi(2) / dt_s;
        let mut correction = Row::zeros();
        for axis in 0..3 {
            let mut h = Row::zeros();
            h.fixed_rows_mut::<3>(ATTITUDE).copy_from(&to_attitude.row(axis).transpose());
            h.fixed_rows_mut::<3>(MOMENTUM).copy_from(&to_momentum.row(axis).transpose());
            h[GYRO_BIAS + axis] = 1.0;
            let on = self.covariance.fixed_columns::<6>(ATTITUDE) * h.fixed_rows::<6>(ATTITUDE)
                + self.covariance.column(GYRO_BIAS + axis);
            self.update_scalar(&h, &on, innovation[axis], variance, &mut correction);
        }
        self.apply(&correction);
    }

    /// Specific force less its lever-arm part, as the vertical (eq. 4.40).
    fn use_force(
        &mut self,
        step: &FilterStep,
        omega_before: &Vector3<f64>,
        force_b: &Vector3<f64>,
    ) -> Update {
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        let (omega, lever) = (self.omega_rad_s, self.parameters.accelerometer_position_b_m);
        let acceleration = (omega - omega_before) / step.dt_s;
        let lever_part = acceleration.cross(&lever) + omega.cross(&omega.cross(&lever));
        let force = force_b - self.force_bias_m_s2 - lever_part;
        let Ok(up) = unit(rotation * force) else { return Update::default() };
        let residual = direction_residual(&up, &Vector3::z_axis());
        let gravity = self.parameters.gravity_m_s2;
        let variance = (self.parameters.accelerometer_noise_m_s2 / gravity).powi(2);
        let mut correction = Row::zeros();
        let mut nis = 0.0;
        // A force c across the vertical looks like the rotation (-c_y, c_x) / g less: R (f - c) = g k
        // turned by -delta.
        let bias_rows = [rotation.row(1).transpose() / gravity, rotation.row(0).transpose() / -gravity];
        for (axis, bias_row) in bias_rows.iter().enumerate() {
            let mut h = Row::zeros();
            h[ATTITUDE + axis] = 1.0;
            h.fixed_rows_mut::<3>(FORCE_BIAS).copy_from(bias_row);
            let on = self.covariance.column(ATTITUDE + axis)
                + self.covariance.fixed_columns::<3>(FORCE_BIAS) * bias_row;
            nis += self.update_scalar(&h, &on, residual[axis], variance, &mut correction);
        }
        self.apply(&correction);
        Update { nis, dof: 2 }
    }
}

fn add_block(p: &mut Covariance, start: usize, value: &Matrix3<f64>) {
    let mut view = p.fixed_view_mut::<3, 3>(start, start);
    view += value;
}

impl GyrostatFilter {
    /// A filter that goes on from an estimate (attitude error in body axes in its covariance).
    #[must_use]
    pub fn new(parameters: &Parameters, body: &BodyModel, start: &Solution) -> Option<Self> {
        let equation = RateEquation::with_known_wheel_speeds(body.inertia_kg_m2)?;
        let rotation = *start.q_world_body.to_rotation_matrix().matrix();
        let mut covariance = Covariance::zeros();
        let p = &start.covariance;
        let attitude: Matrix3<f64> = p.fixed_view::<3, 3>(0, 0).into();
        let cross: Matrix3<f64> = p.fixed_view::<3, 3>(0, 3).into();
        let bias: Matrix3<f64> = p.fixed_view::<3, 3>(3, 3).into();
        let (attitude, cross) = (rotation * attitude * rotation.transpose(), rotation * cross);
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&attitude);
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, GYRO_BIAS).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(GYRO_BIAS, ATTITUDE).copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(GYRO_BIAS, GYRO_BIAS).copy_from(&bias);
        let mut filter = Self {
            parameters: *parameters,
            body: *body,
            equation,
            q_world_body: start.q_world_body,
            momentum_w_n_m_s: Vector3::zeros(),
            gyro_bias_rad_s: start.gyro_bias_rad_s,
            torque_b_n_m: Vector3::zeros(),
            force_bias_m_s2: Vector3::zeros(),
            omega_rad_s: start.omega_rad_s,
            wheel_momentum_b_n_m_s: start.wheel_momentum_b_n_m_s,
            covariance,
        };
        filter.momentum_w_n_m_s =
            rotation * equation.momentum_b_n_m_s(&start.omega_rad_s, &start.wheel_momentum_b_n_m_s);
        // The rate comes from the gyro: it is wrong by one sample's noise and by the bias error.
        let spread = body.inertia_kg_m2 * body.inertia_kg_m2.transpose() * body.rate_sigma_rad_s.powi(2);
        add_block(&mut filter.covariance, MOMENTUM, &(rotation * spread * rotation.transpose()));
        add_block(&mut filter.covariance, TORQUE, &(Matrix3::identity() * body.torque_sigma_n_m.powi(2)));
        let sigma = body.accelerometer_bias_sigma_m_s2;
        add_block(&mut filter.covariance, FORCE_BIAS, &(Matrix3::identity() * (sigma * sigma)));
        Some(filter)
    }

    /// Unmodelled torque, body axes [N m].
    #[must_use]
    pub fn torque_b_n_m(&self) -> Vector3<f64> {
        self.torque_b_n_m
    }
}

impl Kernel for GyrostatFilter {
    fn step(&mut self, step: &FilterStep) -> Update {
        let omega_before = self.omega_rad_s;
        let (transition, middle) = self.predict(step);
        self.propagate_covariance(&transition, step, &omega_before, &middle);
        self.use_gyro(&step.gyro_rad_s, step.dt_s);
        let update = match &step.force_b_m_s2 {
            Some(force_b) => self.use_force(step, &omega_before, force_b),
            None => Update::default(),
        };
        // Rounding must not make the two halves drift apart.
        symmetrise(&mut self.covariance);
        update
    }

    fn takes_raw_force(&self) -> bool {
        true
    }

    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update {
        let columns = across(&measured.reference_w);
        let measured_w = self.q_world_body * measured.direction_b.into_inner();
        let residual = columns.tr_mul(&direction_residual(&measured_w, &measured.reference_w));
        let (mut correction, mut nis) = (Row::zeros(), 0.0);
        for axis in 0..2 {
            let column = columns.column(axis).into_owned();
            let mut h = Row::zeros();
            h.fixed_rows_mut::<3>(ATTITUDE).copy_from(&column);
            let on = self.covariance.fixed_columns::<3>(ATTITUDE) * column;
            nis += self.update_scalar(&h, &on, residual[axis], measured.variance, &mut correction);
        }
        self.apply(&correction);
        Update { nis, dof: 2 }
    }

    fn solution(&self) -> Solution {
        let rotation = *self.q_world_body.to_rotation_matrix().matrix();
        let attitude = rotation.tr_mul(&(block(&self.covariance, ATTITUDE, ATTITUDE) * rotation));
        let cross = rotation.tr_mul(&block(&self.covariance, ATTITUDE, GYRO_BIAS));
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&attitude);
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&block(&self.covariance, GYRO_BIAS, GYRO_BIAS));
        Solution {
            q_world_body: self.q_world_body,
            omega_rad_s: self.omega_rad_s,
            gyro_bias_rad_s: self.gyro_bias_rad_s,
            covariance: (covariance + covariance.transpose()) * 0.5,
            wheel_momentum_b_n_m_s: self.wheel_momentum_b_n_m_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::rotation_vector;

    fn filter() -> (GyrostatFilter, FilterStep) {
        let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        let body = BodyModel::new(inertia, Vector3::new(-0.4, 0.7, -2.0));
        let start = Solution {
            q_world_body: UnitQuaternion::from_euler_angles(0.2, -0.3, 1.0),
            omega_rad_s: Vector3::new(0.2, -0.3, 0.5),
            gyro_bias_rad_s: Vector3::new(0.01, 0.0, -0.02),
            covariance: Matrix6::identity() * 1e-4,
            wheel_momentum_b_n_m_s: Vector3::new(0.5, -1.0, 0.3),
        };
        let mut filter = GyrostatFilter::new(&Parameters::motion_pak_ii(), &body, &start).expect("regular");
        filter.torque_b_n_m = Vector3::new(0.3, -0.2, 0.1);
        let step = FilterStep {
            dt_s: 1e-3,
            gyro_rad_s: start.omega_rad_s,
            gyro_before_rad_s: start.omega_rad_s,
            force_b_m_s2: None,
            wheel_momentum_b_n_m_s: start.wheel_momentum_b_n_m_s + Vector3::new(1e-3, 0.0, -2e-3),
            jet_impulse_b_n_m_s: Vector3::new(0.0, 2e-3, 1e-3),
        };
        (filter, step)
    }

    #[test]
    fn transition_is_the_derivative_of_the_motion() {
        let (reference, step) = filter();
        let mut moved = reference.clone();
        let (transition, _) = moved.predict(&step);
        for state in [0, 1, 2, 3, 4, 5, 9, 10, 11] {
            let mut error = Row::zeros();
            error[state] = 1e-5;
            let mut other = reference.clone();
            other.apply(&error);
            other.predict(&step);
            let attitude = rotation_vector(&(other.q_world_body * moved.q_world_body.inverse())) / 1e-5;
            let momentum = (other.momentum_w_n_m_s - moved.momentum_w_n_m_s) / 1e-5;
            let unit = Vector3::from_fn(|i, _| if i == state % 3 { 1.0 } else { 0.0 });
            let (expected_attitude, expected_momentum) = match state / 3 {
                0 => (unit + transition.attitude_attitude * unit, transition.momentum_attitude * unit),
                1 => (transition.attitude_momentum * unit, unit),
                _ => (Vector3::zeros(), transition.momentum_torque * unit),
            };
            // Beyond the first order in the step: 1e-6 times accelerations of order one.
            assert!((attitude - expected_attitude).norm() < 5e-6, "attitude, state {state}");
            assert!((momentum - expected_momentum).norm() < 5e-5, "momentum, state {state}: {momentum}");
        }
    }

    #[test]
    fn rate_sensitivity_is_the_derivative() {
        let (reference, _) = filter();
        let rotation = *reference.q_world_body.to_rotation_matrix().matrix();
        let (to_attitude, to_momentum) = reference.rate_sensitivity(&rotation);
        for state in 0..6 {
            let mut error = Row::zeros();
            error[state] = 1e-6;
            let mut other = reference.clone();
            other.apply(&error);
            let numeric =
                (other.omega_rad_s - reference.rate(&rotation, &reference.wheel_momentum_b_n_m_s)) / 1e-6;
            let expected = if state < 3 { to_attitude.column(state) } else { to_momentum.column(state - 3) };
            assert!((numeric - expected).norm() < 1e-6, "state {state}");
        }
    }

    #[test]
    fn a_free_gyrostat_keeps_its_momentum() {
        let (mut filter, mut step) = filter();
        filter.body.gravity_offset_b_n_m = Vector3::zeros();
        filter.torque_b_n_m = Vector3::zeros();
        step.jet_impulse_b_n_m_s = Vector3::zeros();
        let before = filter.momentum_w_n_m_s;
        for _ in 0..1000 {
            filter.predict(&step);
        }
        assert!((filter.momentum_w_n_m_s - before).norm() < 1e-12);
        let rotation = *filter.q_world_body.to_rotation_matrix().matrix();
        let total = rotation * (filter.body.inertia_kg_m2 * filter.omega_rad_s + step.wheel_momentum_b_n_m_s);
        assert!((total - before).norm() < 1e-9);
    }
}
