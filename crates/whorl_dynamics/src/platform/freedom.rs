//! Which motion a rig leaves its body.

use nalgebra::{Matrix3, Unit, Vector3};

/// What the body may do. Constraints are ideal: what bears them does no work, so the motion that is left follows from the
/// equation of motion without their torque ([`crate::gyrostat::equation`]).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Freedom {
    /// On a spherical air bearing: it turns about all three axes, and weight acts about the centre of rotation.
    #[default]
    OnBearing,
    /// On a shaft: it turns about one axis that is fixed in the body and in the world. Its direction in the world follows
    /// from the attitude at the start; weight acts as far as it turns about this axis.
    Hinge {
        /// The shaft, body axes.
        axis_b: Unit<Vector3<f64>>,
    },
    /// Held: a bench on which only the wheels move.
    Clamped,
    /// A spacecraft: it turns about all three axes, and weight has no moment and is not felt.
    Free,
}

impl Freedom {
    /// How many axes it turns about: 3, 1 or 0.
    #[must_use]
    pub fn axes(&self) -> usize {
        match self {
            Self::OnBearing | Self::Free => 3,
            Self::Hinge { .. } => 1,
            Self::Clamped => 0,
        }
    }

    /// Whether the body can turn at all.
    #[must_use]
    pub fn turns(&self) -> bool {
        *self != Self::Clamped
    }

    /// The shaft of a hinge, body axes.
    #[must_use]
    pub fn hinge_axis_b(&self) -> Option<Unit<Vector3<f64>>> {
        match self {
            Self::Hinge { axis_b } => Some(*axis_b),
            _ => None,
        }
    }

    /// Whether weight can turn the body and an accelerometer feels it.
    #[must_use]
    pub fn has_weight(&self) -> bool {
        *self != Self::Free
    }

    /// The matrix that takes a body vector to its share along the axes that are free: identity, a a^T or zero.
    #[must_use]
    pub fn projection(&self) -> Matrix3<f64> {
        match self {
            Self::OnBearing | Self::Free => Matrix3::identity(),
            Self::Hinge { axis_b } => axis_b.into_inner() * axis_b.transpose(),
            Self::Clamped => Matrix3::zeros(),
        }
    }

    /// The share of a body vector along the axes that are free: of a rate or an angular acceleration what is possible, of
    /// a torque what is not borne by the constraint.
    #[must_use]
    #[inline]
    pub fn share(&self, v_b: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::OnBearing | Self::Free => *v_b,
            Self::Hinge { axis_b } => axis_b.into_inner() * axis_b.dot(v_b),
            Self::Clamped => Vector3::zeros(),
        }
    }

    /// Angular acceleration for each torque, body axes [1/(kg m^2)], of a body with this inertia \[kg m^2\]: J^-1,
    /// a a^T / (a^T J a) or zero. `None` when the inertia has no inverse.
    #[must_use]
    pub fn mobility(&self, inertia_b_kg_m2: &Matrix3<f64>) -> Option<Matrix3<f64>> {
        match self {
            Self::OnBearing | Self::Free => inertia_b_kg_m2.try_inverse(),
            Self::Hinge { axis_b } => {
                let about_axis = axis_b.dot(&(inertia_b_kg_m2 * axis_b.into_inner()));
                (about_axis > 0.0).then(|| self.projection() / about_axis)
            }
            Self::Clamped => Some(Matrix3::zeros()),
        }
    }

    /// The rate that a gyro with these axes shows, body axes [rad/s]: of a hinge, the turn about its shaft that fits
    /// the axes best; of a clamped body zero. `None` when the axes that are fitted leave the motion open.
    #[must_use]
    pub fn rate_from_gyro_b_rad_s(
        &self,
        reading_rad_s: &Vector3<f64>,
        fitted: [bool; 3],
    ) -> Option<Vector3<f64>> {
        match self {
            Self::OnBearing | Self::Free => fitted.iter().all(|axis| *axis).then_some(*reading_rad_s),
            Self::Clamped => Some(Vector3::zeros()),
            Self::Hinge { axis_b } => {
                let seen = Vector3::from(fitted.map(f64::from)).component_mul(axis_b);
                let size = seen.norm_squared();
                // An axis within 6 deg of square to the shaft says more about its mounting than about the rate.
                (size > 0.01).then(|| {
                    let along =
                        (0..3).filter(|i| fitted[*i]).map(|i| seen[i] * reading_rad_s[i]).sum::<f64>();
                    axis_b.into_inner() * (along / size)
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hinge(axis: [f64; 3]) -> Freedom {
        Freedom::Hinge { axis_b: Unit::new_normalize(Vector3::from(axis)) }
    }

    #[test]
    fn a_hinge_resists_with_the_inertia_about_its_axis() {
        let inertia = Matrix3::new(6.2, -0.9, -0.2, -0.9, 7.5, 0.1, -0.2, 0.1, 12.1);
        let oblique = hinge([1.0, 1.0, 0.0]);
        let mobility = oblique.mobility(&inertia).expect("positive definite");
        // (xx + yy + 2 xy) / 2 about this axis.
        let expected = Vector3::new(1.0, 1.0, 0.0) / 2.0 / ((6.2 + 7.5 - 1.8) / 2.0);
        assert!((mobility * Vector3::x() - expected).norm() < 1e-15);
        assert_eq!(Freedom::Clamped.mobility(&inertia), Some(Matrix3::zeros()));
        assert_eq!(Freedom::Free.mobility(&inertia), inertia.try_inverse());
    }

    #[test]
    fn a_gyro_axis_shows_the_turn_of_a_hinge_that_it_sees() {
        let oblique = hinge([0.6, 0.0, 0.8]);
        let rate = Vector3::new(0.6, 0.0, 0.8) * 2.0;
        for fitted in [[true, true, true], [false, false, true], [true, false, false]] {
            let reading = Vector3::from(std::array::from_fn(|i| if fitted[i] { rate[i] } else { f64::NAN }));
            let found = oblique.rate_from_gyro_b_rad_s(&reading, fitted).expect("seen");
            assert!((found - rate).norm() < 1e-15);
        }
        assert_eq!(oblique.rate_from_gyro_b_rad_s(&rate, [false, true, false]), None, "square to the shaft");
        assert_eq!(Freedom::OnBearing.rate_from_gyro_b_rad_s(&rate, [true, false, true]), None);
        assert_eq!(Freedom::Clamped.rate_from_gyro_b_rad_s(&rate, [false; 3]), Some(Vector3::zeros()));
    }
}
