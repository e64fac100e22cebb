//! The chief's rotating frame: radial, near-velocity, orbit-normal (2.6)-(2.8).

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::orbit_state::OrbitState;

/// Position and velocity of a deputy seen from the chief, in the chief's Hill frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HillState {
    /// x, y, z \[m\].
    pub position_m: Vector3<f64>,
    /// Their time derivatives \[m/s\].
    pub velocity_m_s: Vector3<f64>,
}

/// Rotates Hill axes into inertial axes: `v_eci = R * v_hill`.
#[must_use]
pub fn eci_from_hill(chief: &OrbitState) -> Rotation3<f64> {
    let radial = chief.position_m / chief.position_m.norm();
    let h = chief.position_m.cross(&chief.velocity_m_s);
    let normal = h / h.norm();
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[radial, normal.cross(&radial), normal]))
}

/// Rate of the Hill frame (2.6): of the true anomaly \[rad/s\].
#[must_use]
pub fn anomaly_rate_rad_s(chief: &OrbitState) -> f64 {
    chief.position_m.cross(&chief.velocity_m_s).norm() / chief.position_m.norm_squared()
}

impl HillState {
    /// The deputy seen from the chief.
    #[must_use]
    pub fn of(chief: &OrbitState, deputy: &OrbitState) -> Self {
        let to_hill = eci_from_hill(chief).inverse();
        let position_m = to_hill * (deputy.position_m - chief.position_m);
        let turning = Vector3::new(0.0, 0.0, anomaly_rate_rad_s(chief)).cross(&position_m);
        Self { position_m, velocity_m_s: to_hill * (deputy.velocity_m_s - chief.velocity_m_s) - turning }
    }

    /// The deputy's state in inertial axes.
    #[must_use]
    pub fn deputy(&self, chief: &OrbitState) -> OrbitState {
        let to_eci = eci_from_hill(chief);
        let turning = Vector3::new(0.0, 0.0, anomaly_rate_rad_s(chief)).cross(&self.position_m);
        OrbitState {
            position_m: chief.position_m + to_eci * self.position_m,
            velocity_m_s: chief.velocity_m_s + to_eci * (self.velocity_m_s + turning),
        }
    }
}
