//! States and parameters in one filter (eqs. 4.92-4.94).

use nalgebra::{UnitQuaternion, Vector3};
use whorl_dynamics::{ModelPrior, PlatformModel};

use super::joint_model::{JointModel, Mean, Posterior, STATE, StateMatrix, StateVector};
use super::noise::Noise;
use super::physics::{Carried, Motion};
use super::sample::AveragedSample;
use super::{SequentialEstimate, extended, unscented};
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassVector, mass_vector, prior_stddev};
use whorl_dynamics::realisability::smallest_density_moment_kg_m2;

/// Longest step that is integrated \[s\]; a longer gap resets the motion.
const LONGEST_STEP_S: f64 = 0.5;
/// What is known exactly still gets this as uncertainty, to keep matrices regular.
const EXACT: f64 = 1e-9;

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

/// Joint estimation of motion and mass properties.
#[derive(Debug, Clone)]
pub struct JointFilter {
    model: JointModel,
    posterior: Posterior,
    update: JointUpdate,
    last: Option<AveragedSample>,
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
        let values = mass_vector(&model.mass_properties);
        let carried = Carried::new(model);
        let model = &carried.platform;
        let stddev = prior_stddev(prior).map(|s| s.max(EXACT));
        let gyro = &model.sensors.gyro.errors;
        let mut variance = StateVector::repeat(0.05_f64.powi(2));
        variance.fixed_rows_mut::<3>(3).fill(0.02_f64.powi(2));
        variance.fixed_rows_mut::<3>(6).copy_from(&gyro.bias_turn_on_stddev.map(|s| s.powi(2) + 1e-10));
        for n in 0..MASS_PARAMETERS {
            variance[9 + n] = stddev[n].powi(2);
        }
        Self {
            posterior: Posterior {
                mean: Mean {
                    motion: Motion { q_world_body, omega_wb_b_rad_s: Vector3::zeros() },
                    gyro_bias_rad_s: gyro.bias,
                    values,
                },
                covariance: StateMatrix::from_diagonal(&variance),
            },
            model: JointModel {
                noise: Noise::new(model),
                carried: carried.clone(),
                forgetting_per_s: forgetting_per_s.clamp(0.5, 1.0),
                prior: stddev,
            },
            update,
            last: None,
        }
    }

    /// Takes in one averaged sample; `None` until there are two, and when the sample could not be used.
    pub fn step(&mut self, point: &AveragedSample) -> Option<SequentialEstimate> {
        let Some(last) = self.last.replace(point.clone()) else {
            self.posterior.mean.motion.omega_wb_b_rad_s =
                point.gyro_b_rad_s - self.posterior.mean.gyro_bias_rad_s;
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
        let (model, posterior) = (&self.model, &self.posterior);
        let next = match self.update {
            JointUpdate::Unscented => unscented::step(model, posterior, &last, point),
            JointUpdate::Extended => extended::step(model, posterior, &last, point, 1),
            JointUpdate::Iterated { iterations } => {
                extended::step(model, posterior, &last, point, iterations.max(1))
            }
        };
        let Some(next) = next.filter(plausible) else {
            // A step to an impossible state is not taken; the motion follows the gyro.
            self.lose_motion(point);
            return None;
        };
        self.posterior = next;
        let covariance =
            self.posterior.covariance.fixed_view::<MASS_PARAMETERS, MASS_PARAMETERS>(9, 9).into_owned();
        Some(SequentialEstimate {
            time_s: point.time_s,
            estimate: MassVector::from_fn(|i, _| self.posterior.mean.values[i]),
            covariance,
            prior_stddev: self.model.prior,
        })
    }

    /// The motion is unknown again; the estimate of the parameters stays.
    fn lose_motion(&mut self, point: &AveragedSample) {
        self.posterior.mean.motion.omega_wb_b_rad_s =
            point.gyro_b_rad_s - self.posterior.mean.gyro_bias_rad_s;
        for n in 0..6 {
            for m in 0..STATE {
                self.posterior.covariance[(n, m)] = 0.0;
                self.posterior.covariance[(m, n)] = 0.0;
            }
            self.posterior.covariance[(n, n)] = if n < 3 { 0.05_f64.powi(2) } else { 0.02_f64.powi(2) };
        }
    }
}

/// Whether a state is possible at all.
fn plausible(posterior: &Posterior) -> bool {
    let mass = MassVector::from_fn(|i, _| posterior.mean.values[i]);
    mass.iter().all(|x| x.is_finite())
        && smallest_density_moment_kg_m2(&whorl_dynamics::mass_parameters::inertia_b_kg_m2(&mass)) > -0.5
        && posterior.covariance.diagonal().iter().all(|v| *v >= 0.0 && v.is_finite())
}
