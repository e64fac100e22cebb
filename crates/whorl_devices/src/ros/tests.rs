//! What foreign messages become, against numbers that can be had by hand.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_msgs::geometry_msgs::PoseStamped;
use whorl_msgs::sensor_msgs::MagneticField;
use whorl_msgs::topics::Message;

use super::direction::Source;

fn pose(x: f64, y: f64, z: f64, w: f64) -> Message {
    let mut pose = PoseStamped::default();
    let q = &mut pose.pose.orientation;
    (q.x, q.y, q.z, q.w) = (x, y, z, w);
    pose.into()
}

#[test]
fn a_pose_gives_the_reference_as_the_body_sees_it() {
    let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let source = |q_body_tracked, q_world_tracker| Source::Pose {
        q_body_tracked,
        q_world_tracker,
        reference_w: Vector3::x_axis(),
    };
    let none = UnitQuaternion::identity();
    // Turned left by 90 deg (half angle 45 deg about z): east is to the right.
    let left = pose(0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    let seen = source(none, none).direction_b(&left).unwrap();
    assert!((seen - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12, "{seen}");
    // The marker's x axis points to the platform's left: the platform itself is not turned.
    let seen = source(turned, none).direction_b(&left).unwrap();
    assert!((seen - Vector3::x()).norm() < 1e-12, "{seen}");
    // The tracker's x axis points north: what it calls level and straight is turned left.
    let seen = source(none, turned).direction_b(&pose(0.0, 0.0, 0.0, 1.0)).unwrap();
    assert!((seen - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12, "{seen}");
    for lost in [pose(0.0, 0.0, 0.0, 0.0), pose(f64::NAN, 0.0, 0.0, 1.0), pose(0.0, 0.0, 0.0, 1.1)] {
        assert!(source(none, none).direction_b(&lost).unwrap_err().contains("norm"));
    }
}

#[test]
fn a_field_is_a_direction_in_body_axes_unless_it_is_too_weak() {
    let q_body_sensor = UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0);
    let source = Source::Field { q_body_sensor };
    let field = |x: f64, y: f64, z: f64| {
        let magnetic_field = Vector3::new(x, y, z).into();
        Message::from(MagneticField { magnetic_field, ..MagneticField::default() })
    };
    let seen = source.direction_b(&field(30e-6, 0.0, 40e-6)).unwrap();
    assert!((seen - Vector3::new(0.6, 0.0, -0.8)).norm() < 1e-12, "{seen}");
    assert!(source.direction_b(&field(1e-6, 0.0, 0.0)).unwrap_err().contains("1.0 uT"));
    assert!(source.direction_b(&field(f64::NAN, 1e-5, 0.0)).is_err());
}
