//! A rough initial attitude from two directions, and the correction of a gyro-driven attitude towards measured
//! directions.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, unit_or};

/// The attitude that best aligns the vertical with `up_b` and a vector sensor's reference with its measured direction,
/// the first of `seen` (body axes; the second is the reference in world axes) (TRIAD: M. Shuster and
/// S. Oh, J. Guidance and Control 4, 1981). Heading is zero if only the vertical was measured.
#[must_use]
pub fn start_attitude(
    up_b: Unit<Vector3<f64>>,
    seen: Option<(Vector3<f64>, Unit<Vector3<f64>>)>,
) -> UnitQuaternion<f64> {
    seen.and_then(|(direction_b, reference_world)| {
        let seen_b = unit_or(direction_b, reference_world);
        attitude_from_two_vectors(&up_b, &Vector3::z_axis(), &seen_b, &reference_world).ok()
    })
    .unwrap_or_else(|| attitude_from_vertical(up_b, 0.0))
}

/// The correction rate per unit gain that turns the body towards the measured direction, body axes: the
/// innovation of the explicit complementary filter (R. Mahony, T. Hamel and J.-M. Pflimlin, IEEE Trans. Automatic
/// Control 53, 2008). Its size is the sine of the angle error.
#[must_use]
pub fn pull(
    q_world_body: &UnitQuaternion<f64>,
    seen_b: &Vector3<f64>,
    in_world: &Vector3<f64>,
) -> Vector3<f64> {
    seen_b.cross(&q_world_body.inverse_transform_vector(in_world))
}
