//! Topics that only imported recordings have. No node sends them.
//!
//! All are in a platform's namespace. Names that end in `_<n>` count sensors from 2.

/// Motor torques in force from the stamp on (`sensor_msgs/JointState`, `effort` [N m]), as commanded to
/// the drives, each until the next.
pub const WHEEL_COMMAND: &str = "wheels/command";

/// Known torque on the body from other actuators, body axes [N m] (`geometry_msgs/Vector3Stamped`), each until
/// the next.
pub const BODY_TORQUE: &str = "body_torque";

/// More vector sensors than any platform has.
pub const MAX_VECTOR_SENSORS: usize = 16;

/// Directions measured by vector sensor `index` (from 0), body axes (`geometry_msgs/Vector3Stamped`).
#[must_use]
pub fn vector_direction(index: usize) -> String {
    format!("{}/direction", vector_sensor(index))
}

/// The same direction in the world (east, north, up), sent once (`geometry_msgs/Vector3Stamped`, frame `world`).
/// It wins over the platform's parameter.
#[must_use]
pub fn vector_reference(index: usize) -> String {
    format!("{}/reference", vector_sensor(index))
}

fn vector_sensor(index: usize) -> String {
    match index {
        0 => "vector_sensor".to_owned(),
        later => format!("vector_sensor_{}", later + 1),
    }
}
