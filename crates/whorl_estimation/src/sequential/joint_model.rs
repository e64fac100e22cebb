//! State, motion, noise and readings of the joint filters.

use nalgebra::{DVector, SMatrix, SVector, Vector3};
use whorl_math::{attitude_error, quaternion_exp};

use super::forgetting::forget;
use super::noise::Noise;
use super::physics::{Carried, Motion, Physics};
use super::sample::AveragedSample;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector};

/// Attitude error, rate, gyro bias, parameters.
pub(super) const STATE: usize = 9 + MASS_PARAMETERS;
pub(super) type StateVector = SVector<f64, STATE>;
pub(super) type StateMatrix = SMatrix<f64, STATE, STATE>;

/// Unexplained torque [N m sqrt(s)].
const TORQUE_NOISE_N_M_SQRT_S: f64 = 5e-4;

/// Mean of the state.
#[derive(Debug, Clone)]
pub(super) struct Mean {
    pub motion: Motion,
    pub gyro_bias_rad_s: Vector3<f64>,
    /// The nine parameters.
    pub values: MassVector,
}

impl Mean {
    pub fn moved(&self, change: &StateVector) -> Self {
        let part = |at: usize| Vector3::new(change[at], change[at + 1], change[at + 2]);
        let mut values = self.values;
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

/// Mean and covariance of the state.
#[derive(Debug, Clone)]
pub(super) struct Posterior {
    pub mean: Mean,
    pub covariance: StateMatrix,
}

/// What the filter knows besides the state.
#[derive(Debug, Clone)]
pub(super) struct JointModel {
    pub carried: Carried,
    pub noise: Noise,
    /// lambda of eq. 4.97, per second.
    pub forgetting_per_s: f64,
    /// Standard deviations of the nine parameters before the start.
    pub prior: MassVector,
}

impl JointModel {
    pub fn carried(&self, mean: &Mean, last: &AveragedSample, point: &AveragedSample) -> Option<Mean> {
        let physics = Physics::new(&self.carried, &mean.values)?;
        Some(Mean { motion: physics.step(&mean.motion, last, point), ..mean.clone() })
    }

    /// Noise of a step from this mean, and forgetting applied to the parameters.
    pub fn with_process(&self, mean: &Mean, covariance: &StateMatrix, dt_s: f64) -> StateMatrix {
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
        let walk = self.carried.platform.sensors.gyro.errors.bias_walk;
        for axis in 0..3 {
            let inertia = mean.values[[0, 3, 5][axis]].max(1e-3);
            grown[(axis, axis)] += 1e-12;
            grown[(3 + axis, 3 + axis)] += (TORQUE_NOISE_N_M_SQRT_S / inertia).powi(2) * dt_s;
            grown[(6 + axis, 6 + axis)] += walk[axis].powi(2) * dt_s;
        }
        0.5 * (grown + grown.transpose())
    }

    /// Ideal readings.
    pub fn readings(&self, mean: &Mean, point: &AveragedSample) -> Option<DVector<f64>> {
        let physics = Physics::new(&self.carried, &mean.values)?;
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
    pub fn measured(&self, point: &AveragedSample) -> (DVector<f64>, DVector<f64>) {
        let mut z: Vec<f64> = point.gyro_b_rad_s.iter().copied().collect();
        let mut variance: Vec<f64> = (self.noise.gyro / point.gyro_samples).iter().copied().collect();
        if let Some((force, samples)) = &point.specific_force_b_m_s2 {
            z.extend(force);
            let bias =
                self.carried.platform.sensors.accelerometer.errors.bias_turn_on_stddev.map(|s| s.powi(2));
            variance.extend(&(self.noise.accelerometer / *samples + bias));
        }
        for d in &point.directions {
            z.extend(&d.direction_b);
            variance.extend([self.noise.direction; 3]);
        }
        (DVector::from_vec(z), DVector::from_vec(variance))
    }
}
