//! Axes of a sensor that are not at right angles.

use nalgebra::Vector3;

/// `T^-1 x` of a lower triangular T with ones on its diagonal and `skew` = (T_yx, T_zx, T_zy) \[rad\]: forward substitution.
pub(super) fn untangled(x: &Vector3<f64>, skew: &Vector3<f64>) -> Vector3<f64> {
    let y = x.y - skew.x * x.x;
    Vector3::new(x.x, y, x.z - skew.y * x.x - skew.z * y)
}
