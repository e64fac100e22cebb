//! Removes the sensor errors known from the model from every sample before the filter uses it.

use nalgebra::Vector3;
use whorl_dynamics::platform::{SensorSuite, TriaxialErrors};
use whorl_math::quaternion_exp;

/// Known errors of a platform's sensors, effects of the model included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    gyro: TriaxialErrors,
    accelerometer: TriaxialErrors,
    vector_misalignment_rad: Vector3<f64>,
}

impl Calibration {
    /// Of these sensors.
    #[must_use]
    pub fn new(sensors: &SensorSuite) -> Self {
        Self {
            gyro: sensors.gyro.errors,
            accelerometer: sensors.accelerometer.errors,
            vector_misalignment_rad: sensors.vector.map_or(Vector3::zeros(), |v| v.misalignment_rad),
        }
    }

    /// Rate in body axes [rad/s].
    #[must_use]
    pub fn rate_b_rad_s(&self, reading: &Vector3<f64>) -> Vector3<f64> {
        self.gyro.corrected(reading)
    }

    /// Specific force in body axes [m/s^2].
    #[must_use]
    pub fn specific_force_b_m_s2(&self, reading: &Vector3<f64>) -> Vector3<f64> {
        self.accelerometer.corrected(reading)
    }

    /// Direction in body axes.
    #[must_use]
    pub fn direction_b(&self, reading: &Vector3<f64>) -> Vector3<f64> {
        quaternion_exp(&self.vector_misalignment_rad) * reading
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_dynamics::PlatformModel;

    #[test]
    fn a_model_without_errors_changes_nothing() {
        let calibration = Calibration::new(&PlatformModel::whorl_1_reference().sensors);
        let v = Vector3::new(0.1, -0.2, 9.8);
        assert_eq!(calibration.rate_b_rad_s(&v), v);
        assert_eq!(calibration.specific_force_b_m_s2(&v), v);
        assert!((calibration.direction_b(&v) - v).norm() < 1e-15);
    }

    #[test]
    fn adopted_sensor_effects_are_taken_out() {
        let mut model = PlatformModel::whorl_1_reference();
        let scale = std::collections::BTreeMap::from([("scale_z".to_owned(), 0.01)]);
        model.effects.insert("gyro_scale".to_owned(), scale);
        let adjusted = whorl_dynamics::Gyrostat::new(&model).unwrap();
        let calibration = Calibration::new(&adjusted.model().sensors);
        let rate = calibration.rate_b_rad_s(&Vector3::new(0.0, 0.0, 1.01));
        assert!((rate.z - 1.0).abs() < 1e-12, "{rate}");
    }
}
