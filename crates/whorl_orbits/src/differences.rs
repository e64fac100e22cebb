//! Relative orbital elements (2.36), (2.37).
//!
//! Source: Schwartz 2004, section 2.1.4; H. Schaub, K. T. Alfriend, "Hybrid Cartesian and orbit element feedback
//! law for formation flying spacecraft", J. Guidance, Control, and Dynamics 25(2), 2002.

use nalgebra::Vector3;
use whorl_math::wrap_angle_rad;

use crate::elements::Elements;

/// (2.37): differences that stay constant on unperturbed orbits with the same semi-major axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClassicalDifferences {
    /// Of the semi-major axis \[m\].
    pub semi_major_axis_m: f64,
    /// Of the mean anomaly \[rad\].
    pub mean_anomaly_rad: f64,
    /// Of the inclination \[rad\].
    pub inclination_rad: f64,
    /// Of the argument of perigee \[rad\].
    pub perigee_rad: f64,
    /// Of the eccentricity.
    pub eccentricity: f64,
    /// Of the node \[rad\].
    pub node_rad: f64,
}

impl ClassicalDifferences {
    /// Of a deputy against its chief.
    #[must_use]
    pub fn of(chief: &Elements, deputy: &Elements) -> Self {
        Self {
            semi_major_axis_m: deputy.semi_major_axis_m - chief.semi_major_axis_m,
            mean_anomaly_rad: wrap_angle_rad(deputy.mean_anomaly_rad - chief.mean_anomaly_rad),
            inclination_rad: deputy.inclination_rad - chief.inclination_rad,
            perigee_rad: wrap_angle_rad(deputy.perigee_rad - chief.perigee_rad),
            eccentricity: deputy.eccentricity - chief.eccentricity,
            node_rad: wrap_angle_rad(deputy.node_rad - chief.node_rad),
        }
    }

    /// The deputy's elements.
    #[must_use]
    pub fn deputy(&self, chief: &Elements) -> Elements {
        Elements {
            semi_major_axis_m: chief.semi_major_axis_m + self.semi_major_axis_m,
            eccentricity: chief.eccentricity + self.eccentricity,
            inclination_rad: chief.inclination_rad + self.inclination_rad,
            node_rad: chief.node_rad + self.node_rad,
            perigee_rad: chief.perigee_rad + self.perigee_rad,
            mean_anomaly_rad: chief.mean_anomaly_rad + self.mean_anomaly_rad,
        }
    }
}

/// (2.36): differences without the singularity of the circle. `theta = omega + nu`, `q1 = e cos omega`, `q2 = e
/// sin omega`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NonsingularDifferences {
    /// Of the semi-major axis \[m\].
    pub semi_major_axis_m: f64,
    /// Of the true latitude \[rad\].
    pub latitude_rad: f64,
    /// Of the inclination \[rad\].
    pub inclination_rad: f64,
    /// Of `q1`.
    pub q1: f64,
    /// Of `q2`.
    pub q2: f64,
    /// Of the node \[rad\].
    pub node_rad: f64,
}

fn latitude_and_q(elements: &Elements) -> (f64, f64, f64) {
    let (sine, cosine) = elements.perigee_rad.sin_cos();
    let latitude_rad = elements.perigee_rad + elements.true_anomaly_rad();
    (latitude_rad, elements.eccentricity * cosine, elements.eccentricity * sine)
}

impl NonsingularDifferences {
    /// Of a deputy against its chief.
    #[must_use]
    pub fn of(chief: &Elements, deputy: &Elements) -> Self {
        let (latitude_c, q1_c, q2_c) = latitude_and_q(chief);
        let (latitude_d, q1_d, q2_d) = latitude_and_q(deputy);
        Self {
            semi_major_axis_m: deputy.semi_major_axis_m - chief.semi_major_axis_m,
            latitude_rad: wrap_angle_rad(latitude_d - latitude_c),
            inclination_rad: deputy.inclination_rad - chief.inclination_rad,
            q1: q1_d - q1_c,
            q2: q2_d - q2_c,
            node_rad: wrap_angle_rad(deputy.node_rad - chief.node_rad),
        }
    }

    /// The deputy's elements.
    #[must_use]
    pub fn deputy(&self, chief: &Elements) -> Elements {
        let (latitude_c, q1_c, q2_c) = latitude_and_q(chief);
        let (q1, q2) = (q1_c + self.q1, q2_c + self.q2);
        let (eccentricity, perigee_rad) = (q1.hypot(q2), q2.atan2(q1));
        let anomaly = latitude_c + self.latitude_rad - perigee_rad;
        Elements {
            semi_major_axis_m: chief.semi_major_axis_m + self.semi_major_axis_m,
            eccentricity,
            inclination_rad: chief.inclination_rad + self.inclination_rad,
            node_rad: chief.node_rad + self.node_rad,
            perigee_rad,
            mean_anomaly_rad: Elements::mean_from_true_rad(eccentricity, anomaly),
        }
    }

    /// The deputy's position in the chief's Hill frame to first order: the linear map of Schaub and Alfriend
    /// \[m\].
    #[must_use]
    pub fn hill_position_m(&self, chief: &Elements) -> Vector3<f64> {
        let (latitude, q1, q2) = latitude_and_q(chief);
        let (sine, cosine) = latitude.sin_cos();
        let (a, p) = (chief.semi_major_axis_m, chief.parameter_m());
        let radius = p / (1.0 + q1 * cosine + q2 * sine);
        // Radial over transverse velocity.
        let slope = (q1 * sine - q2 * cosine) * radius / p;
        let radial = radius / a * self.semi_major_axis_m + slope * radius * self.latitude_rad
            - radius / p * (2.0 * a * q1 + radius * cosine) * self.q1
            - radius / p * (2.0 * a * q2 + radius * sine) * self.q2;
        Vector3::new(
            radial,
            radius * (self.latitude_rad + chief.inclination_rad.cos() * self.node_rad),
            radius * (sine * self.inclination_rad - cosine * chief.inclination_rad.sin() * self.node_rad),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hill::HillState;
    use proptest::prelude::*;

    fn elements() -> impl Strategy<Value = Elements> {
        (6.8e6..9e6_f64, 0.0..0.1_f64, 0.2..2.8_f64, prop::array::uniform3(-3.0..3.0_f64)).prop_map(
            |(
                semi_major_axis_m,
                eccentricity,
                inclination_rad,
                [node_rad, perigee_rad, mean_anomaly_rad],
            )| {
                Elements {
                    semi_major_axis_m,
                    eccentricity,
                    inclination_rad,
                    node_rad,
                    perigee_rad,
                    mean_anomaly_rad,
                }
            },
        )
    }

    proptest! {
        #[test]
        fn differences_give_the_deputy_back(chief in elements(), d in prop::array::uniform6(-1e-3..1e-3_f64)) {
            let one = NonsingularDifferences {
                semi_major_axis_m: d[0] * 1e6, latitude_rad: d[1], inclination_rad: d[2], q1: d[3], q2: d[4], node_rad: d[5],
            };
            let deputy = one.deputy(&chief);
            let direct = deputy.state();
            let classical = ClassicalDifferences::of(&chief, &deputy).deputy(&chief).state();
            prop_assert!((classical.position_m - direct.position_m).norm() < 1e-3);
            let back = NonsingularDifferences::of(&chief, &deputy);
            prop_assert!((back.latitude_rad - d[1]).abs() < 1e-9 && (back.q1 - d[3]).abs() < 1e-12);
        }

        #[test]
        fn the_linear_map_is_the_position_to_first_order(chief in elements(), d in prop::array::uniform6(-1e-6..1e-6_f64)) {
            let one = NonsingularDifferences {
                semi_major_axis_m: d[0] * 1e6, latitude_rad: d[1], inclination_rad: d[2], q1: d[3], q2: d[4], node_rad: d[5],
            };
            let exact = HillState::of(&chief.state(), &one.deputy(&chief).state()).position_m;
            let linear = one.hill_position_m(&chief);
            // Tens of metres apart: second order is (20 m)^2 / 7000 km.
            prop_assert!((exact - linear).norm() < 1e-3, "{exact} {linear}");
        }
    }
}
