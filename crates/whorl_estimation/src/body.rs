//! Model of the body for the filters that use dynamics.

use crate::parameters::ParameterError;
use nalgebra::{Matrix3, Vector3};

/// Mass properties, and how far the model of the motion may be trusted. All sigmas are standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyModel {
    /// About the centre of rotation, wheels included, body axes [kg m^2].
    pub inertia_kg_m2: Matrix3<f64>,
    /// m g r_cg, body axes [N m].
    pub gravity_offset_b_n_m: Vector3<f64>,
    /// Whether it has wheels or other parts that store momentum: this must then arrive with the samples.
    pub stores_momentum: bool,
    /// Relative error of the inertia \[1\].
    pub inertia_relative_sigma: f64,
    /// White torque noise [N m/sqrt(Hz)].
    pub torque_noise_n_m_sqrt_hz: f64,
    /// Initial unmodelled torque, fixed in the body [N m].
    pub torque_sigma_n_m: f64,
    /// How fast it wanders [N m/sqrt(s)].
    pub torque_walk_n_m_sqrt_s: f64,
    /// Relative error of the jets' impulse \[1\].
    pub jet_relative_sigma: f64,
    /// Noise of one sample of the wheels' momentum, per axis [N m s].
    pub wheel_momentum_noise_n_m_s: f64,
    /// Relative error of the gyro's scale \[1\].
    pub gyro_scale_sigma: f64,
    /// Turn-on bias of the accelerometer [m/s^2].
    pub accelerometer_bias_sigma_m_s2: f64,
    /// Its random walk [m/s^2/sqrt(s)].
    pub accelerometer_bias_walk_m_s2_sqrt_s: f64,
    /// Initial error of the rate [rad/s].
    pub rate_sigma_rad_s: f64,
}

impl BodyModel {
    /// A body of this inertia and balance with the uncertainties of a laboratory platform: inertia to
    /// 2 %, jets to 5 %, MotionPak II class sensors.
    #[must_use]
    pub fn new(inertia_kg_m2: Matrix3<f64>, gravity_offset_b_n_m: Vector3<f64>) -> Self {
        Self {
            inertia_kg_m2,
            gravity_offset_b_n_m,
            stores_momentum: true,
            inertia_relative_sigma: 0.02,
            torque_noise_n_m_sqrt_hz: 3e-5,
            torque_sigma_n_m: 0.02,
            torque_walk_n_m_sqrt_s: 1e-4,
            jet_relative_sigma: 0.05,
            wheel_momentum_noise_n_m_s: 1e-3,
            gyro_scale_sigma: 1e-3,
            accelerometer_bias_sigma_m_s2: 1.5e-3,
            accelerometer_bias_walk_m_s2_sqrt_s: 1e-5,
            rate_sigma_rad_s: 5e-3,
        }
    }

    /// Refuses values that a filter cannot work with.
    ///
    /// # Errors
    /// The first field that is not allowed.
    pub fn check(&self) -> Result<(), ParameterError> {
        let asymmetry = (self.inertia_kg_m2 - self.inertia_kg_m2.transpose()).amax();
        if asymmetry.is_nan() || asymmetry > 1e-9 || self.inertia_kg_m2.cholesky().is_none() {
            return Err(ParameterError {
                name: "inertia_kg_m2 (smallest eigenvalue)",
                value: self.inertia_kg_m2.symmetric_eigenvalues().min(),
                allowed: "above zero, of a symmetric matrix",
            });
        }
        let not_negative = [
            ("inertia_relative_sigma", self.inertia_relative_sigma),
            ("torque_noise_n_m_sqrt_hz", self.torque_noise_n_m_sqrt_hz),
            ("torque_sigma_n_m", self.torque_sigma_n_m),
            ("torque_walk_n_m_sqrt_s", self.torque_walk_n_m_sqrt_s),
            ("jet_relative_sigma", self.jet_relative_sigma),
            ("wheel_momentum_noise_n_m_s", self.wheel_momentum_noise_n_m_s),
            ("gyro_scale_sigma", self.gyro_scale_sigma),
            ("accelerometer_bias_sigma_m_s2", self.accelerometer_bias_sigma_m_s2),
            ("accelerometer_bias_walk_m_s2_sqrt_s", self.accelerometer_bias_walk_m_s2_sqrt_s),
            ("rate_sigma_rad_s", self.rate_sigma_rad_s),
            ("gravity_offset_b_n_m (length)", self.gravity_offset_b_n_m.norm()),
        ];
        match not_negative.iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            Some(&(name, value)) => Err(ParameterError { name, value, allowed: "finite and not negative" }),
            None => Ok(()),
        }
    }
}
