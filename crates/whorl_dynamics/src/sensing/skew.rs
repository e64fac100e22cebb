//! Axes of a sensor that are not at right angles.

use nalgebra::Vector3;

/// `T x` of a lower triangular T with ones on its diagonal and `skew` = (T_yx, T_zx, T_zy) \[rad\]: what the axes see.
#[must_use]
pub fn tangled(x: &Vector3<f64>, skew: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(x.x, x.y + skew.x * x.x, x.z + skew.y * x.x + skew.z * x.y)
}

/// `T^-1 x` of the same, by forward substitution.
#[must_use]
pub fn untangled(x: &Vector3<f64>, skew: &Vector3<f64>) -> Vector3<f64> {
    let y = x.y - skew.x * x.x;
    Vector3::new(x.x, y, x.z - skew.y * x.x - skew.z * y)
}
