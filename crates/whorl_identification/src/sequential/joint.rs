//! States and parameters in one filter (eqs. 4.92-4.94).

use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix, SMatrix, SVector, UnitQuaternion, Vector3};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_math::covariance::correct;
use whorl_math::{attitude_error, quaternion_exp};

use super::SequentialEstimate;
use super::dual::forget;
use crate::data::Point;
use crate::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};
use crate::realisability::smallest_density_moment_kg_m2;
use crate::trajectory::{Motion, Noise, Physics, Unknowns};

/// Attitude error, rate, gyro bias, parameters.
pub(super) const STATE: usize = 9 + MASS_PARAMETERS;
pub(super) type StateVector = SVector<f64, STATE>;
pub(super) type StateMatrix = SMatrix<f64, STATE, STATE>;
/// One row for each reading.
type Jacobian = OMatrix<f64, Dyn, Const<STATE>>;

/// Differences for derivatives.
const DIFFERENCE: f64 = 1e-6;
/// Unexplained torque [N m sqrt(s)].
const TORQUE_NOISE_N_M_SQRT_S: f64 = 5e-4;
/// Longest step that is integrated \[s\]; a longer gap resets the motion.
const LONGEST_STEP_S: f64 = 0.5;

/// How measurements are taken in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointUpdate {
    /// Extended Kalman filter.
    Extended,
    /// Iterated: relinearised this many times.
    Iterated {
        /// Iterations, at least 1.
        iterations: usize,
    },
    /// Unscented, with 2 n points of equal weight.
    Unscented,
}

/// Mean of the state.
#[derive(Debug, Clone)]
pub(super) struct Mean {
    pub motion: Motion,
    pub gyro_bias_rad_s: Vector3<f64>,
    /// Unknowns of the physics; only the nine parameters change.
    pub values: DVector<f64>,
}

impl Mean {
    pub fn moved(&self, change: &StateVector) -> Self {
        let part = |at: usize| Vector3::new(change[at], change[at + 1], change[at + 2]);
        let mut values = self.values.clone();
        for n in 0..MASS_PARAMETERS {
            values[n] += change[9 + n];
        }
        Self {
            motion: Motion {
                q_world_body: self.motion.q_world_body * quaternion_exp(&part(0)),
                omega_wb_b_rad_s: self.motion.omega_wb_b_rad_s + part(3),
            },
            gyro_bias_rad_s: self.gyro_bias_rad_s + part(6),
            values,
        }
    }

    /// The change that leads from here to there.
    pub fn to(&self, there: &Self) -> StateVector {
        let mut change = StateVector::zeros();
        let turn = attitude_error(&self.motion.q_world_body, &there.motion.q_world_body);
        change.fixed_rows_mut::<3>(0).copy_from(&turn);
        let rate = there.motion.omega_wb_b_rad_s - self.motion.omega_wb_b_rad_s;
        change.fixed_rows_mut::<3>(3).copy_from(&rate);
        change.fixed_rows_mut::<3>(6).copy_from(&(there.gyro_bias_rad_s - self.gyro_bias_rad_s));
        for n in 0..MASS_PARAMETERS {
            change[9 + n] = there.values[n] - self.values[n];
        }
        change
    }
}

/// Joint estimation of motion and mass properties.
#[derive(Debug, Clone)]
pub struct JointFilter {
    pub(super) model: PlatformModel,
    pub(super) unknowns: Unknowns,
    pub(super) noise: Noise,
    pub(super) mean: Mean,
    pub(super) covariance: StateMatrix,
    update: JointUpdate,
    /// lambda of eq. 4.97, per second.
    forgetting_per_s: f64,
    last: Option<Point>,
    prior: MassVector,
}

impl JointFilter {
    /// Starts from a model, how well it is known, and an attitude that is good to some degrees.
    /// `forgetting_per_s` is the forgetting factor over one second, 1 = never forget.
    #[must_use]
    pub fn new(
        model: &PlatformModel,
        prior: &ModelPrior,
        update: JointUpdate,
        forgetting_per_s: f64,
        q_world_body: UnitQuaternion<f64>,
    ) -> Self {
        let unknowns = Unknowns::new(model, prior, Vec::new());
        // Impossible effects are refused where the model is read.
        let corrected = unknowns.effect_set(&unknowns.mean).adjusted(model).unwrap_or_else(|_| model.clone());
        let model = &corrected;
        let stddev = MassVector::from_fn(|i, _| unknowns.stddev[i]);
        let gyro = &model.sensors.gyro.errors;
        let mut variance = StateVector::repeat(0.05_f64.powi(2));
        variance.fixed_rows_mut::<3>(3).fill(0.02_f64.powi(2));
        variance.fixed_rows_mut::<3>(6).copy_from(&gyro.bias_turn_on_stddev.map(|s| s.powi(2) + 1e-10));
        for n in 0..MASS_PARAMETERS {
            variance[9 + n] = stddev[n].powi(2);
        }
        Self {
            noise: Noise::new(model),
            mean: Mean {
                motion: Motion { q_world_body, omega_wb_b_rad_s: Vector3::zeros() },
                gyro_bias_rad_s: gyro.bias,
                values: unknowns.mean.clone(),
            },
            covariance: StateMatrix::from_diagonal(&variance),
            update,
            forgetting_per_s: forgetting_per_s.clamp(0.5, 1.0),
            last: None,
            prior: stddev,
            model: model.clone(),
            unknowns,
        }
    }

    /// Takes in one averaged sample; `None` until there are two, and when the sample could not be used.
    pub fn step(&mut self, point: &Point) -> Option<SequentialEstimate> {
        let Some(last) = self.last.replace(point.clone()) else {
            self.mean.motion.omega_wb_b_rad_s = point.gyro_b_rad_s - self.mean.gyro_bias_rad_s;
            return None;
        };
        let dt_s = point.time_s - last.time_s;
        if dt_s <= 0.0 {
            return None;
        }
        // Not a number counts as a gap.
        if dt_s.is_nan() || dt_s > LONGEST_STEP_S {
            self.lose_motion(point);
            return None;
        }
        let before = (self.mean.clone(), self.covariance);
        let done = match self.update {
            JointUpdate::Unscented => self.unscented(&last, point, dt_s),
            JointUpdate::Extended => self.extended(&last, point, dt_s, 1),
            JointUpdate::Iterated { iterations } => self.extended(&last, point, dt_s, iterations.max(1)),
        };
        if done.is_none() || !self.plausible() {
            // A step to an impossible state is not taken; the motion follows the gyro.
            (self.mean, self.covariance) = before;
            self.lose_motion(point);
            return None;
        }
        let covariance = self.covariance.fixed_view::<MASS_PARAMETERS, MASS_PARAMETERS>(9, 9).into_owned();
        Some(SequentialEstimate {
            time_s: point.time_s,
            estimate: MassVector::from_fn(|i, _| self.mean.values[i]),
            covariance,
            prior_stddev: self.prior,
        })
    }

    fn plausible(&self) -> bool {
        let mass = MassVector::from_fn(|i, _| self.mean.values[i]);
        mass.iter().all(|x| x.is_finite())
            && smallest_density_moment_kg_m2(&crate::mass_parameters::inertia_b_kg_m2(&mass)) > -0.5
            && self.covariance.diagonal().iter().all(|v| *v >= 0.0 && v.is_finite())
    }

    /// The motion is unknown again; the estimate of the parameters stays.
    fn lose_motion(&mut self, point: &Point) {
        self.mean.motion.omega_wb_b_rad_s = point.gyro_b_rad_s - self.mean.gyro_bias_rad_s;
        for n in 0..6 {
            for m in 0..STATE {
                self.covariance[(n, m)] = 0.0;
                self.covariance[(m, n)] = 0.0;
            }
            self.covariance[(n, n)] = if n < 3 { 0.05_f64.powi(2) } else { 0.02_f64.powi(2) };
        }
    }

    pub(super) fn carried(&self, mean: &Mean, last: &Point, point: &Point) -> Option<Mean> {
        let physics = Physics::new(&self.unknowns, &mean.values)?;
        Some(Mean { motion: physics.step(&mean.motion, last, point), ..mean.clone() })
    }

    /// Noise of a step, and forgetting applied to the parameters.
    pub(super) fn with_process(&self, covariance: &StateMatrix, dt_s: f64) -> StateMatrix {
        let mut grown = *covariance;
        let lambda = self.forgetting_per_s.powf(dt_s);
        let parameters = grown.fixed_view::<MASS_PARAMETERS, MASS_PARAMETERS>(9, 9).into_owned();
        let forgotten: MassCovariance = forget(&parameters, &self.prior, lambda);
        for n in 0..MASS_PARAMETERS {
            let scale = (forgotten[(n, n)] / parameters[(n, n)].max(1e-300)).sqrt();
            for m in 0..9 {
                grown[(m, 9 + n)] *= scale;
                grown[(9 + n, m)] *= scale;
            }
        }
        grown.fixed_view_mut::<MASS_PARAMETERS, MASS_PARAMETERS>(9, 9).copy_from(&forgotten);
        let walk = self.model.sensors.gyro.errors.bias_walk;
        for axis in 0..3 {
            let inertia = self.mean.values[[0, 3, 5][axis]].max(1e-3);
            grown[(axis, axis)] += 1e-12;
            grown[(3 + axis, 3 + axis)] += (TORQUE_NOISE_N_M_SQRT_S / inertia).powi(2) * dt_s;
            grown[(6 + axis, 6 + axis)] += walk[axis].powi(2) * dt_s;
        }
        0.5 * (grown + grown.transpose())
    }

    /// Ideal readings.
    pub(super) fn readings(&self, mean: &Mean, point: &Point) -> Option<DVector<f64>> {
        let physics = Physics::new(&self.unknowns, &mean.values)?;
        let imu = physics.imu(&mean.motion, point);
        let mut z: Vec<f64> = (imu.angular_velocity_b_rad_s + mean.gyro_bias_rad_s).iter().copied().collect();
        if point.specific_force_b_m_s2.is_some() {
            z.extend(&imu.specific_force_b_m_s2);
        }
        for d in &point.directions {
            z.extend(&physics.seen(&mean.motion, &d.reference_world));
        }
        Some(DVector::from_vec(z))
    }

    /// Readings and their variances. The accelerometer's bias is not estimated: its uncertainty is noise,
    /// spread over a second's samples.
    pub(super) fn measured(&self, point: &Point) -> (DVector<f64>, DVector<f64>) {
        let mut z: Vec<f64> = point.gyro_b_rad_s.iter().copied().collect();
        let mut variance: Vec<f64> = (self.noise.gyro / point.gyro_samples).iter().copied().collect();
        if let Some((force, samples)) = &point.specific_force_b_m_s2 {
            z.extend(force);
            let bias = self.model.sensors.accelerometer.errors.bias_turn_on_stddev.map(|s| s.powi(2));
            variance.extend(&(self.noise.accelerometer / *samples + bias));
        }
        for d in &point.directions {
            z.extend(&d.direction_b);
            variance.extend([self.noise.direction; 3]);
        }
        (DVector::from_vec(z), DVector::from_vec(variance))
    }

    fn extended(&mut self, last: &Point, point: &Point, dt_s: f64, iterations: usize) -> Option<()> {
        let carried = self.carried(&self.mean, last, point)?;
        let mut transition = StateMatrix::identity();
        for n in (0..6).chain(9..STATE) {
            let change = StateVector::ith(n, DIFFERENCE);
            let moved = self.carried(&self.mean.moved(&change), last, point)?;
            transition.set_column(n, &(carried.to(&moved) / DIFFERENCE));
        }
        let mut covariance =
            self.with_process(&(transition * self.covariance * transition.transpose()), dt_s);
        let (z, variance) = self.measured(point);
        let noise = DMatrix::from_diagonal(&variance);
        let mut mean = carried.clone();
        let mut last_linearisation = None;
        let mut jacobian = Jacobian::zeros(z.len());
        for _ in 0..iterations {
            let base = self.readings(&mean, point)?;
            for n in 0..STATE {
                let moved = self.readings(&mean.moved(&StateVector::ith(n, DIFFERENCE)), point)?;
                jacobian.set_column(n, &((moved - &base) / DIFFERENCE));
            }
            let cross = covariance * jacobian.transpose();
            let spread = &jacobian * &cross + &noise;
            let gain = &cross * spread.clone().cholesky()?.inverse();
            // The iterated filter's innovation counts from the predicted state.
            let back = mean.to(&carried);
            let step = &gain * (&z - &base - &jacobian * back);
            mean = carried.moved(&step);
            last_linearisation = Some((gain, cross, spread));
        }
        let (gain, cross, spread) = last_linearisation?;
        correct(&mut covariance, &gain, &cross, &spread);
        (self.mean, self.covariance) = (mean, covariance);
        Some(())
    }
}
