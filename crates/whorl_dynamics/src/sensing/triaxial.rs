//! Three-axis sensors.

use nalgebra::Vector3;
use whorl_math::quaternion_exp;

use super::scalar::quantised;
use super::skew::{tangled, untangled};
use crate::platform::TriaxialErrors;

impl TriaxialErrors {
    /// What the sensor reads for `truth` in body axes, all in its own unit.
    ///
    /// y = (1 + scale) * T R(m)^T truth + bias + noise, then clipped to +-range, then rounded to the
    /// quantum; R(m) = exp(misalignment x) turns body axes into sensor axes, T is lower triangular with ones on its diagonal and
    /// below it the skew (T_yx, T_zx, T_zy). `bias` is the whole
    /// bias of the moment (constant, turn-on and walk), `standard_normal` one draw per axis.
    #[must_use]
    pub fn reading(
        &self,
        truth: &Vector3<f64>,
        bias: &Vector3<f64>,
        standard_normal: &Vector3<f64>,
    ) -> Vector3<f64> {
        let y = self.ideal(truth) + bias + self.noise_stddev.component_mul(standard_normal);
        // `max` then `min` instead of `clamp`, which panics for a range that is not a number.
        y.map(|x| quantised(x.max(-self.range).min(self.range), self.quantum))
    }

    /// Its reading of `truth` without bias, noise and limits: (1 + scale) * T R(m)^T truth.
    #[must_use]
    pub fn ideal(&self, truth: &Vector3<f64>) -> Vector3<f64> {
        let seen = if self.misalignment_rad == Vector3::zeros() {
            *truth
        } else {
            quaternion_exp(&self.misalignment_rad).inverse_transform_vector(truth)
        };
        let seen = tangled(&seen, &self.skew_rad);
        seen + self.scale.component_mul(&seen)
    }

    /// What the sensor saw, in body axes, with the known constant errors removed from its reading:
    /// R(m) T^-1 ((y - bias) / (1 + scale)). Noise, turn-on bias and walk stay in.
    #[must_use]
    pub fn corrected(&self, reading: &Vector3<f64>) -> Vector3<f64> {
        let seen = (reading - self.bias).component_div(&self.scale.map(|s| 1.0 + s));
        let seen = untangled(&seen, &self.skew_rad);
        if self.misalignment_rad == Vector3::zeros() {
            seen
        } else {
            quaternion_exp(&self.misalignment_rad) * seen
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PlatformModel;

    fn clean() -> TriaxialErrors {
        let mut errors = PlatformModel::whorl_1_reference().sensors.gyro.errors;
        errors.range = 10.0;
        errors
    }

    #[test]
    fn each_error_reaches_the_reading() {
        let truth = Vector3::new(1.0, -2.0, 0.5);
        let zero = Vector3::zeros();
        assert_eq!(clean().reading(&truth, &zero, &zero), truth);
        let bias = Vector3::new(0.1, 0.2, -0.3);
        assert_eq!(clean().reading(&truth, &bias, &zero), truth + bias);
        let scaled = TriaxialErrors { scale: Vector3::new(0.1, 0.0, -0.5), ..clean() };
        assert!((scaled.reading(&truth, &zero, &zero) - Vector3::new(1.1, -2.0, 0.25)).norm() < 1e-15);
        // The y axis sees 0.1 of x; the z axis 0.2 of x and -0.3 of y, as they are along the body's axes.
        let skewed = TriaxialErrors { skew_rad: Vector3::new(0.1, 0.2, -0.3), ..clean() };
        assert!((skewed.reading(&truth, &zero, &zero) - Vector3::new(1.0, -1.9, 1.3)).norm() < 1e-15);
        let noisy = TriaxialErrors { noise_stddev: Vector3::new(1.0, 2.0, 3.0), ..clean() };
        assert_eq!(noisy.reading(&zero, &zero, &Vector3::repeat(1.0)), Vector3::new(1.0, 2.0, 3.0));
        let clipped = TriaxialErrors { range: 0.75, ..clean() };
        assert_eq!(clipped.reading(&truth, &zero, &zero), Vector3::new(0.75, -0.75, 0.5));
        let stepped = TriaxialErrors { quantum: 0.3, ..clean() };
        assert!((stepped.reading(&truth, &zero, &zero) - Vector3::new(0.9, -2.1, 0.6)).norm() < 1e-12);
    }

    #[test]
    fn known_errors_are_taken_out() {
        let errors = TriaxialErrors {
            bias: Vector3::new(0.01, -0.02, 0.03),
            scale: Vector3::new(0.02, -0.01, 0.005),
            misalignment_rad: Vector3::new(0.01, 0.02, -0.03),
            skew_rad: Vector3::new(-0.02, 0.01, 0.03),
            ..clean()
        };
        let truth = Vector3::new(1.0, -2.0, 0.5);
        let reading = errors.reading(&truth, &errors.bias, &Vector3::zeros());
        assert!((reading - truth).norm() > 0.05);
        assert!((errors.corrected(&reading) - truth).norm() < 1e-12);
    }

    #[test]
    fn a_sensor_turned_left_sees_the_vector_turned_right() {
        // Sensor axes turned by +90 degrees about z: body x is then along the sensor's -y.
        let misalignment_rad = Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let turned = TriaxialErrors { misalignment_rad, ..clean() };
        let seen = turned.reading(&Vector3::x(), &Vector3::zeros(), &Vector3::zeros());
        assert!((seen - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-15);
    }
}
