//! A rough first attitude: from two directions, then along the gyro with a pull towards what is seen.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::{attitude_from_two_vectors, attitude_from_vertical, unit_or};

/// The attitude in which the vertical is seen along `up_b`, and a vector sensor's reference along the first of
/// `seen` (body axes; the second is the reference in world axes), as nearly as both can be (TRIAD: M. Shuster and
/// S. Oh, J. Guidance and Control 4, 1981). Heading is zero where nothing but the vertical was seen.
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

/// The rate that turns the body, per unit of gain, such that a direction of the world appears where it is seen: the
/// innovation of the explicit complementary filter (R. Mahony, T. Hamel and J.-M. Pflimlin, IEEE Trans. Automatic
/// Control 53, 2008). The sine of the angle that is missing, body axes.
#[must_use]
pub fn pull(
    q_world_body: &UnitQuaternion<f64>,
    seen_b: &Vector3<f64>,
    in_world: &Vector3<f64>,
) -> Vector3<f64> {
    seen_b.cross(&q_world_body.inverse_transform_vector(in_world))
}
