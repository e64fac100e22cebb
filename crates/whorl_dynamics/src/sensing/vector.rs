//! The vector sensor.

use nalgebra::{Unit, UnitQuaternion, Vector3};
use whorl_math::{quaternion_exp, unit_or};

use crate::platform::VectorSensor;

impl VectorSensor {
    /// Direction that the sensor reads in attitude `q_world_body`.
    ///
    /// y = R(m)^T (v_b turned by a small random angle about each of two axes across it); R(m) as for
    /// three-axis sensors. Noise has no component along the direction, so the reading has unit length.
    #[must_use]
    pub fn reading(
        &self,
        q_world_body: &UnitQuaternion<f64>,
        standard_normal: &[f64; 2],
    ) -> Unit<Vector3<f64>> {
        let direction_b = q_world_body.inverse_transform_vector(&self.reference_direction_world);
        let helper = if direction_b.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
        let e1 = unit_or(direction_b.cross(&helper), Vector3::x_axis()).into_inner();
        let e2 = direction_b.cross(&e1);
        let [first, second] = standard_normal;
        let noise = quaternion_exp(&((e1 * *first + e2 * *second) * self.noise_stddev_rad));
        let seen = quaternion_exp(&self.misalignment_rad).inverse() * noise * direction_b;
        unit_or(seen, self.reference_direction_world)
    }
}
