//! A filter algorithm steps with a good sample and corrects with a direction. Gates, late samples, restarts and health
//! are the business of the supervision.

use crate::body::BodyModel;
use crate::parameters::Parameters;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Unit, UnitQuaternion, Vector3};
use whorl_math::covariance;

/// One accepted inertial sample, and what acted on the body since the previous one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterStep {
    /// Time since the previous sample \[s\], above zero.
    pub dt_s: f64,
    /// Rate gyro at the end of the step, body axes [rad/s].
    pub gyro_rad_s: Vector3<f64>,
    /// Rate gyro at its start [rad/s].
    pub gyro_before_rad_s: Vector3<f64>,
    /// Specific force at its end, body axes [m/s^2]; `None` if it was refused.
    pub force_b_m_s2: Option<Vector3<f64>>,
    /// Momentum of the wheels relative to the body at its end, body axes [N m s].
    pub wheel_momentum_b_n_m_s: Vector3<f64>,
    /// Angular impulse of the jets within it, body axes [N m s].
    pub jet_impulse_b_n_m_s: Vector3<f64>,
}

/// The estimate that a kernel starts from and returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Attitude.
    pub q_world_body: UnitQuaternion<f64>,
    /// Body rate, body axes [rad/s].
    pub omega_rad_s: Vector3<f64>,
    /// Gyro bias [rad/s].
    pub gyro_bias_rad_s: Vector3<f64>,
    /// As [`crate::Estimate::covariance`].
    pub covariance: Matrix6<f64>,
    /// Momentum of the wheels relative to the body, body axes [N m s].
    pub wheel_momentum_b_n_m_s: Vector3<f64>,
}

/// A direction seen by a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionMeasurement {
    /// As seen, in the current body axes.
    pub direction_b: Unit<Vector3<f64>>,
    /// The same direction in the world.
    pub reference_w: Unit<Vector3<f64>>,
    /// Variance about each axis across it \[rad^2\].
    pub variance: f64,
}

/// All inputs that a kernel may start with.
#[derive(Clone, Copy, Debug)]
pub struct KernelStart<'a> {
    /// Sensors and gravity.
    pub parameters: &'a Parameters,
    /// The body's dynamics, where they are known.
    pub body: Option<&'a BodyModel>,
    /// The estimate to go on from.
    pub solution: &'a Solution,
}

/// How well measurements agreed with the prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Update {
    /// Normalised innovation squared.
    pub nis: f64,
    /// Its degrees of freedom; 0 without a measurement.
    pub dof: u8,
}

/// One filter algorithm.
pub trait Kernel {
    /// Moves the estimate to the end of the step.
    fn step(&mut self, step: &FilterStep) -> Update;

    /// Whether [`Self::step`] uses the specific force itself, with its lever arm. If not, the vertical comes through
    /// [`Self::correct_direction`], averaged over the accelerometer's window.
    fn takes_raw_force(&self) -> bool {
        false
    }

    /// Corrects with a direction measured in the current body axes.
    fn correct_direction(&mut self, measured: &DirectionMeasurement) -> Update;

    /// A sample of the vector sensor as it came, in its own unit: only for kernels with gates of their own
    /// ([`crate::FilterKind::own_gates`]).
    fn take_raw_vector(&mut self, _vector_b: &Vector3<f64>) {}

    /// The current estimate.
    fn solution(&self) -> Solution;
}

/// Measurement update (eqs. 4.50-4.53) by three components of equal and independent noise, of which `dof` are
/// independent of one another: the correction, and how well the innovation agreed. No correction, and nothing changed,
/// if the innovation's covariance is not positive definite.
pub fn correct_three_components<const N: usize>(
    p: &mut SMatrix<f64, N, N>,
    h: &SMatrix<f64, 3, N>,
    variance: f64,
    innovation: &Vector3<f64>,
    dof: u8,
) -> (SVector<f64, N>, Update) {
    match covariance::update(p, h, &(Matrix3::identity() * variance), innovation, |_| true) {
        Some(update) => (update.correction, Update { nis: update.nis, dof }),
        None => (SVector::zeros(), Update::default()),
    }
}
