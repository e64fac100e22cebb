//! Where a spacecraft is and how it moves.

use nalgebra::{SVector, Vector3};

/// Position and velocity in inertial axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitState {
    /// Position from the Earth's centre \[m\].
    pub position_m: Vector3<f64>,
    /// Velocity \[m/s\].
    pub velocity_m_s: Vector3<f64>,
}

impl OrbitState {
    pub(crate) fn vector(&self) -> SVector<f64, 6> {
        let mut x = SVector::<f64, 6>::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&self.position_m);
        x.fixed_rows_mut::<3>(3).copy_from(&self.velocity_m_s);
        x
    }

    pub(crate) fn from_vector(x: &SVector<f64, 6>) -> Self {
        Self {
            position_m: x.fixed_rows::<3>(0).into_owned(),
            velocity_m_s: x.fixed_rows::<3>(3).into_owned(),
        }
    }
}
