//! Errors of an orientation against truth, split into heading and inclination.
//!
//! As in D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD - A Benchmark for Robust Inertial Orientation
//! Estimation", Data 6(7), 72, 2021: the error rotation `q_estimate q_true^-1` (world axes, z up) is the product of a
//! rotation about the vertical and one about a horizontal axis.

use nalgebra::UnitQuaternion;

/// Sums of squares, sample by sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrientationErrors {
    squares: [f64; 3],
    count: u64,
}

/// Angles of one error \[rad\]: total, heading (signed), inclination.
#[must_use]
pub fn orientation_error(q_estimate: &UnitQuaternion<f64>, q_true: &UnitQuaternion<f64>) -> [f64; 3] {
    let error = q_estimate * q_true.inverse();
    let (w, vertical) = (error.w, error.k);
    let horizontal = error.i.hypot(error.j);
    let total = 2.0 * horizontal.hypot(vertical).atan2(w.abs());
    let heading = 2.0 * (vertical * w.signum()).atan2(w.abs());
    let inclination = 2.0 * horizontal.atan2(w.hypot(vertical));
    [total, heading, inclination]
}

impl OrientationErrors {
    /// Takes in one sample.
    pub fn add(&mut self, q_estimate: &UnitQuaternion<f64>, q_true: &UnitQuaternion<f64>) {
        let errors = orientation_error(q_estimate, q_true);
        for (square, error) in self.squares.iter_mut().zip(errors) {
            *square += error * error;
        }
        self.count += 1;
    }

    /// Samples so far.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Root mean squares of total, heading and inclination \[rad\]; `None` without samples.
    #[must_use]
    pub fn root_mean_square_rad(&self) -> Option<[f64; 3]> {
        (self.count > 0).then(|| self.squares.map(|square| (square / self.count as f64).sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_turn_about_the_vertical_is_heading_and_a_tilt_is_inclination() {
        let truth = UnitQuaternion::from_euler_angles(0.3, -1.0, 2.0);
        let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::new(axis * angle) * truth;
        for angle in [-3.0, -0.2, 1e-8, 0.4, 3.1] {
            let [total, heading, inclination] = orientation_error(&about(Vector3::z(), angle), &truth);
            assert!((heading - angle).abs() < 1e-7 && inclination < 1e-7, "{angle}");
            assert!((total - angle.abs()).abs() < 1e-7);
            let axis = Vector3::new(0.6, 0.8, 0.0);
            let [total, heading, inclination] = orientation_error(&about(axis, angle), &truth);
            assert!((inclination - angle.abs()).abs() < 1e-7 && heading.abs() < 1e-7, "{angle}");
            assert!((total - angle.abs()).abs() < 1e-7);
        }
    }

    #[test]
    fn root_mean_squares_are_those_of_the_samples() {
        let mut errors = OrientationErrors::default();
        assert_eq!(errors.root_mean_square_rad(), None);
        let truth = UnitQuaternion::identity();
        for angle in [0.03, 0.04] {
            errors.add(&UnitQuaternion::new(Vector3::z() * angle), &truth);
        }
        let [total, heading, inclination] = errors.root_mean_square_rad().expect("two samples");
        let expected = (0.5 * (0.03_f64.powi(2) + 0.04_f64.powi(2))).sqrt();
        assert!(
            (total - expected).abs() < 1e-12 && (heading - expected).abs() < 1e-12 && inclination < 1e-12
        );
    }
}
