//! Conversions and queries of messages.

use crate::geometry_msgs::{Quaternion, Vector3};
use crate::whorl::{AttitudeEstimate, ModelFit};

impl AttitudeEstimate {
    /// Whether attitude and rate may be used for control.
    #[must_use]
    pub fn usable(&self) -> bool {
        matches!(self.health, Self::HEALTH_OK | Self::HEALTH_DEGRADED)
    }
}

impl ModelFit {
    /// What the monitor says, in a line: `model mismatch: thruster_strength jet_3 -0.31 +- 0.04 (98 %)`.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self.state {
            Self::STATE_AGREES => "moves as its model says".to_owned(),
            Self::STATE_DOUBT => {
                format!(
                    "may not move as its model says: evidence {:.1} of {:.1}",
                    self.ln_evidence, self.ln_limit
                )
            }
            Self::STATE_MISMATCH => {
                let numbers = self.estimate.iter().zip(&self.stddev).zip(&self.unit);
                let values: Vec<String> = self
                    .parameter
                    .iter()
                    .zip(numbers)
                    .map(|(name, ((estimate, stddev), unit))| {
                        let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
                        format!("{name} {} +- {}{unit}", digits(*estimate), digits(*stddev))
                    })
                    .collect();
                let percent = 100.0 * self.probability;
                format!(
                    "does not move as its model says: {} ({percent:.0} %): {}",
                    self.effect,
                    values.join(", ")
                )
            }
            _ => "not compared with its model now".to_owned(),
        }
    }
}

/// Three digits that count.
fn digits(x: f64) -> String {
    let size = x.abs();
    if size != 0.0 && !(1e-3..1e4).contains(&size) { format!("{x:.2e}") } else { format!("{x:.3}") }
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Vector3> for [f64; 3] {
    fn from(v: Vector3) -> Self {
        [v.x, v.y, v.z]
    }
}

impl From<nalgebra::Vector3<f64>> for Vector3 {
    fn from(v: nalgebra::Vector3<f64>) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<Vector3> for nalgebra::Vector3<f64> {
    fn from(v: Vector3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl From<nalgebra::UnitQuaternion<f64>> for Quaternion {
    fn from(q: nalgebra::UnitQuaternion<f64>) -> Self {
        Self { x: q.i, y: q.j, z: q.k, w: q.w }
    }
}

impl Quaternion {
    /// How far from 1 the norm of a quaternion in a message may be.
    pub const NORM_TOLERANCE: f64 = 1e-3;

    /// The rotation. `None` when a component is not finite or the norm is off by more than
    /// [`Self::NORM_TOLERANCE`]: the message is then invalid and must not be used.
    #[must_use]
    pub fn to_unit(self) -> Option<nalgebra::UnitQuaternion<f64>> {
        let q = nalgebra::Quaternion::new(self.w, self.x, self.y, self.z);
        let norm = q.norm();
        // A NaN fails the comparison.
        ((norm - 1.0).abs() <= Self::NORM_TOLERANCE)
            .then(|| nalgebra::UnitQuaternion::new_unchecked(q / norm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_keep_their_order_and_bad_ones_are_refused() {
        let q = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 2.9);
        assert_eq!(Quaternion::from(q).to_unit().unwrap().coords, (q.quaternion() / q.norm()).coords);
        let quarter_turn_about_z = Quaternion { x: 0.0, y: 0.0, z: 0.5f64.sqrt(), w: 0.5f64.sqrt() };
        let y = quarter_turn_about_z.to_unit().unwrap() * nalgebra::Vector3::x();
        assert!((y - nalgebra::Vector3::y()).norm() < 1e-15);
        assert_eq!(Quaternion { x: f64::NAN, ..Quaternion::default() }.to_unit(), None);
        assert_eq!(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 }.to_unit(), None);
        assert_eq!(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.01 }.to_unit(), None);
    }
}
