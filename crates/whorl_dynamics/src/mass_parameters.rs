//! The nine parameters of eq. 4.73 as a vector.

use crate::mass_properties::MassPropertiesError;
use crate::{MassProperties, ModelPrior};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// How many there are.
pub const MASS_PARAMETERS: usize = 9;

/// I_xx, I_xy, I_xz, I_yy, I_yz, I_zz [kg m^2], m g r_x, m g r_y, m g r_z [N m]: eq. 4.73, matrix
/// elements with their sign in the matrix.
pub type MassVector = SVector<f64, MASS_PARAMETERS>;

/// Covariance of a [`MassVector`].
pub type MassCovariance = SMatrix<f64, MASS_PARAMETERS, MASS_PARAMETERS>;

/// Names in reports, in the order of [`MassVector`].
pub const NAMES: [&str; MASS_PARAMETERS] =
    ["I_xx", "I_xy", "I_xz", "I_yy", "I_yz", "I_zz", "mgr_x", "mgr_y", "mgr_z"];

/// Units, in the same order.
pub const UNITS: [&str; MASS_PARAMETERS] =
    ["kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "N m", "N m", "N m"];

/// The vector of these mass properties.
#[must_use]
pub fn mass_vector(mass: &MassProperties) -> MassVector {
    let (i, c) = (mass.inertia_b_kg_m2(), mass.gravity_offset_b_n_m());
    MassVector::from([i.m11, i.m12, i.m13, i.m22, i.m23, i.m33, c.x, c.y, c.z])
}

/// Mass properties with these values.
///
/// # Errors
/// When no rigid body has them.
pub fn mass_properties(vector: &MassVector, mass_kg: f64) -> Result<MassProperties, MassPropertiesError> {
    MassProperties::new(inertia_b_kg_m2(vector), gravity_offset_b_n_m(vector), mass_kg)
}

/// The inertia matrix.
#[must_use]
pub fn inertia_b_kg_m2(vector: &MassVector) -> Matrix3<f64> {
    let [xx, xy, xz, yy, yz, zz] = [vector[0], vector[1], vector[2], vector[3], vector[4], vector[5]];
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// The gravity offset.
#[must_use]
pub fn gravity_offset_b_n_m(vector: &MassVector) -> Vector3<f64> {
    Vector3::new(vector[6], vector[7], vector[8])
}

/// Standard deviations of a prior in the order of the vector.
#[must_use]
pub fn prior_stddev(prior: &ModelPrior) -> MassVector {
    let (i, c) = (&prior.inertia_b_kg_m2, &prior.gravity_offset_b_n_m);
    MassVector::from([i.m11, i.m12, i.m13, i.m22, i.m23, i.m33, c.x, c.y, c.z])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PlatformModel;
    use crate::gyrostat::equation::inertia_regressor;

    #[test]
    fn vector_and_matrix_agree() {
        let model = PlatformModel::whorl_1_reference();
        let vector = mass_vector(&model.mass_properties);
        // Table 4.1.
        assert_eq!(vector, MassVector::from([6.2, -0.9, -0.2, 7.5, 0.1, 12.1, -0.02, -0.07, -2.0]));
        assert_eq!(mass_properties(&vector, 110.0).unwrap(), model.mass_properties);
        let v = Vector3::new(0.3, -0.2, 0.7);
        let product = inertia_regressor(&v) * vector.fixed_rows::<6>(0);
        assert!((product - inertia_b_kg_m2(&vector) * v).norm() < 1e-15);
    }
}
