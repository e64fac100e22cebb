//! The platform's second direction from a magnetometer (`sensor_msgs/MagneticField`) or from motion capture
//! (`geometry_msgs/PoseStamped`).
//!
//! Motion capture measures the whole orientation. What the estimator takes is one direction: that of
//! `model.sensors.vector.reference_w`, seen from the body. With the specific force it fixes the orientation; a direction that is level
//! fixes yaw best.

use std::time::{Duration, Instant};

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_math::rad_from_deg;
use whorl_msgs::geometry_msgs::PoseStamped;
use whorl_msgs::sensor_msgs::MagneticField;
use whorl_msgs::topics::{Message, MessageType};
use whorl_params::{Reader, range};

use super::emulator::{header, publisher};
use super::stamps::Stamps;
use super::{read_mounting, read_topic, serve_sensor, topic};
use crate::DeviceError;
use crate::device::{Address, Device, DeviceKind, Role, UsedTopic};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::{Measured, Reporter};

/// Row of magnetometers.
pub const MAGNETOMETER: DeviceKind = DeviceKind {
    name: "ros_magnetometer",
    what: "any magnetometer with a ROS 2 driver: sensor_msgs/MagneticField",
    read: |r, model| read(r, model, false),
};

/// Row of motion capture.
pub const POSE: DeviceKind = DeviceKind {
    name: "ros_pose",
    what: "motion capture with a ROS 2 driver: geometry_msgs/PoseStamped",
    read: |r, model| read(r, model, true),
};

/// A magnetic field below this is no direction \[T\]; the Earth's is 25 to 65 uT.
const WEAKEST_FIELD_T: f64 = 5e-6;
/// A quaternion whose norm is further from 1 is no orientation: trackers send zeros when they see nothing.
const NORM_TOLERANCE: f64 = 1e-2;
/// Silent for so many periods of the model's vector sensor, and at least so long.
const SILENT_PERIODS: f64 = 5.0;
const SILENT: Duration = Duration::from_millis(500);

/// One sensor.
#[derive(Debug, Clone)]
pub(super) struct RosDirection {
    pub(super) topic: String,
    pub(super) source: Source,
    /// Period of the model's vector sensor \[s\]; what comes between is left out.
    pub(super) period_s: f64,
    stamps: Stamps,
}

/// Where the direction is from.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Source {
    Field {
        q_body_sensor: UnitQuaternion<f64>,
    },
    Pose {
        /// From the axes of the tracked body to the platform's.
        q_body_tracked: UnitQuaternion<f64>,
        /// From the axes of the tracker to the world's.
        q_world_tracker: UnitQuaternion<f64>,
        reference_w: Unit<Vector3<f64>>,
    },
}

fn read(r: &mut Reader<'_>, model: &PlatformModel, is_pose: bool) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let example = if is_pose { "/vrpn/whorl_1/pose" } else { "/imu/mag" };
    let topic = read_topic(r, "topic", &format!("topic of the driver, such as {example}"));
    let mounting =
        read_mounting(r, if is_pose { "the axes of the tracked body" } else { "the sensor's axes" });
    let world = is_pose.then(|| {
        let doc = "roll, pitch, yaw of the tracker's axes in the world's (east, north, up) [deg]";
        r.vector3_or("world_deg", Vector3::zeros(), range(-180.0..=180.0), doc)
    });
    let stamps = Stamps::read(r);
    let Some(vector) = model.sensors.vector else {
        let problem = "it measures a direction; allowed: on a platform with model.sensors.vector";
        r.reject("kind", problem);
        return None;
    };
    let source = match world {
        None => Source::Field { q_body_sensor: mounting },
        Some(angles) => {
            let [roll, pitch, yaw] = [angles.x, angles.y, angles.z].map(rad_from_deg);
            Source::Pose {
                q_body_tracked: mounting,
                q_world_tracker: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
                reference_w: vector.reference_direction_world,
            }
        }
    };
    let period_s = 1.0 / vector.rate_hz;
    (r.error_count() == before)
        .then(|| Box::new(RosDirection { topic, source, period_s, stamps }) as Box<dyn Device>)
}

impl Source {
    pub(super) fn message_type(&self) -> MessageType {
        match self {
            Self::Field { .. } => MessageType::MagneticField,
            Self::Pose { .. } => MessageType::PoseStamped,
        }
    }

    /// The direction, body axes.
    pub(super) fn direction_b(&self, message: &Message) -> Result<Vector3<f64>, String> {
        match (self, message) {
            (Self::Field { q_body_sensor }, Message::MagneticField(field)) => {
                let field_t: Vector3<f64> = field.magnetic_field.into();
                let direction =
                    field_t.try_normalize(WEAKEST_FIELD_T).filter(|d| d.iter().all(|x| x.is_finite()));
                let direction = direction.ok_or_else(|| {
                    format!("a field of {:.1} uT is no direction (is it in tesla?)", field_t.norm() * 1e6)
                })?;
                Ok(q_body_sensor * direction)
            }
            (Self::Pose { q_body_tracked, q_world_tracker, reference_w }, Message::PoseStamped(pose)) => {
                let q = &pose.pose.orientation;
                let q = Quaternion::new(q.w, q.x, q.y, q.z);
                let off = (q.norm() - 1.0).abs();
                if off.is_nan() || off >= NORM_TOLERANCE {
                    return Err("its quaternion has not the norm 1: does it see the platform?".to_owned());
                }
                let q_world_body =
                    q_world_tracker * UnitQuaternion::from_quaternion(q) * q_body_tracked.inverse();
                Ok(q_world_body.inverse() * reference_w.into_inner())
            }
            _ => Err("it is of another type".to_owned()),
        }
    }
}

impl Device for RosDirection {
    fn addresses(&self) -> Vec<Address> {
        vec![Address(self.topic.clone())]
    }

    fn topics(&self) -> Vec<UsedTopic> {
        vec![UsedTopic { name: self.topic.clone(), is_read: true }]
    }

    fn roles(&self) -> Vec<Role> {
        vec![Role::Direction]
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        let topic = topic(place, &self.topic, self.source.message_type());
        let silent = SILENT.max(Duration::from_secs_f64(self.period_s * SILENT_PERIODS));
        // A little early is in time.
        let period = Duration::from_secs_f64(self.period_s * 0.99);
        let mut told: Option<Instant> = None;
        serve_sensor(place, topic, self.stamps.clone(), silent, mailbox, reporter, |at, message| {
            let direction = self.source.direction_b(&message)?;
            if told.is_none_or(|told| at.saturating_duration_since(told) >= period) {
                told = Some(at);
                reporter.measured(at, Measured::Direction(direction));
            }
            Ok(())
        })
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulated(self)
    }
}

/// The field at the laboratory \[T\]; its direction is that of the model's vector sensor.
const FIELD_T: f64 = 5e-5;

/// The sensor as it looks from its topic.
fn emulated(direction: &RosDirection) -> Emulator {
    let RosDirection { topic, source, period_s, .. } = direction;
    let message_type = source.message_type();
    match source.clone() {
        Source::Field { q_body_sensor } => {
            publisher(topic, message_type, 1.0 / period_s, move |at_ns, world| {
                let direction_b = world.plant.sample_vector()?.direction.into_inner();
                let field = q_body_sensor.inverse() * direction_b * FIELD_T;
                let magnetic_field = field.into();
                let header = header(at_ns);
                Some(MagneticField { header, magnetic_field, ..MagneticField::default() }.into())
            })
        }
        // Without noise: a tracker's is small against that of other sensors.
        Source::Pose { q_body_tracked, q_world_tracker, .. } => {
            publisher(topic, message_type, 1.0 / period_s, move |at_ns, world| {
                let q_world_body = world.plant.truth().q_world_body;
                let q: UnitQuaternion<f64> = q_world_tracker.inverse() * q_world_body * q_body_tracked;
                let mut message = PoseStamped { header: header(at_ns), ..PoseStamped::default() };
                message.pose.orientation = q.into();
                Some(message.into())
            })
        }
    }
}
