//! The topic map for bags of other systems: a YAML file, see docs/recordings.md.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_bag::{BagReader, BagTopic, Channel, Form};
use whorl_math::words::or_did_you_mean;
use whorl_params::{ParameterErrors, ParameterTree, Reader};

use super::poses;
use super::roles::Role;
use crate::error::or_none;

/// The map beside a bag that is used without being asked for.
pub(super) const BESIDE_A_BAG: &str = "channels.yaml";

/// `sensor_msgs/MagneticField` begins as a `Vector3Stamped` does: header, then three numbers.
const MAGNETIC_FIELD: &str = "sensor_msgs/msg/MagneticField";
/// Inertial sensors whose halves come on topics of their own.
const HALVES: [(&str, Channel); 2] = [("gyro", Channel::Gyro), ("accelerometer", Channel::Accelerometer)];

/// A map that fits the bag.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct TopicMap {
    /// Name of the platform, if it is given.
    pub platform: Option<String>,
    /// Topic -> what it holds.
    pub roles: BTreeMap<String, Vec<Role>>,
    /// Topic -> frame that its messages must name, where several sensors publish it.
    pub frames: BTreeMap<String, String>,
    /// Of each vector sensor.
    pub references: Vec<Option<Unit<Vector3<f64>>>>,
    /// Joints that are the wheels, in their order, for each of the wheels' channels that names some.
    pub joints: BTreeMap<Channel, Vec<String>>,
    /// Whether the efforts of the wheels' state are the torques that were commanded.
    pub effort_is_command: bool,
    pub closed_loop: Option<bool>,
    pub clamped: bool,
    /// No valve opened, although no topic says so.
    pub jets_off: bool,
}

impl TopicMap {
    /// Reads a map file and checks it against the bag.
    pub fn load(path: &Path, bag: &BagReader) -> Result<Self, ParameterErrors> {
        Ok(whorl_params::read(&ParameterTree::load_for(path, "bag")?, |r| Self::read(r, bag))?.0)
    }

    fn read(r: &mut Reader<'_>, bag: &BagReader) -> Self {
        let mut map = Self::default();
        for channel in Channel::ALL {
            let info = channel.info();
            match info.form {
                Form::Directions => map.read_sensors(r, *channel, bag),
                _ => map.add(r, info.topic_key, Role::Measured(*channel, 0), bag),
            }
            if matches!(info.form, Form::Wheels { .. }) && r.has(info.topic_key) {
                map.read_joints(r, *channel);
            }
        }
        for (key, channel) in HALVES {
            if r.has(key) && r.has("imu") {
                let one =
                    "imu has gyro and accelerometer already; allowed: imu alone, or gyro and accelerometer";
                r.reject(&format!("{key}.topic"), one);
            }
            map.add(r, key, Role::Measured(channel, 0), bag);
        }
        map.read_pose(r, bag);
        map.add(r, "actuator_command", Role::ActuatorCommand, bag);
        map.platform = r.optional_string("platform", "name of the platform");
        map.closed_loop =
            r.has("closed_loop").then(|| r.bool("closed_loop", "whether a controller was running"));
        map.clamped = r.choice_or(
            "mounting",
            "on_bearing",
            &["on_bearing", "clamped"],
            "clamped: the body was held, only the wheels moved",
        ) == "clamped";
        map.jets_off = r.bool_or(
            "jets_off",
            false,
            "whether the jets were off: no valve opened during the run, although no topic says so",
        );
        map
    }

    /// Takes up the topic of a key.
    fn add(&mut self, r: &mut Reader<'_>, key: &str, role: Role, bag: &BagReader) {
        if let Some(topic) = topic(r, key, role, bag) {
            let one =
                "frame that the messages name (header.frame_id), where several sensors publish the topic";
            if let Some(frame) = r.optional_string(&format!("{key}.frame_id"), one) {
                self.frames.insert(topic.clone(), frame);
            }
            self.roles.entry(topic).or_default().push(role);
        }
    }

    /// One sensor (`vector`), or several by names of their own (`vectors.<name>`).
    fn read_sensors(&mut self, r: &mut Reader<'_>, channel: Channel, bag: &BagReader) {
        let mut sensors: Vec<String> = vec![channel.info().topic_key.to_owned()];
        let several = r.parameters().children("vectors");
        sensors.extend(several.into_iter().map(|name| format!("vectors.{name}")));
        let sensors = sensors.into_iter().filter(|key| r.has(key)).collect::<Vec<_>>();
        for (index, key) in sensors.iter().enumerate() {
            self.add(r, key, Role::Measured(channel, index), bag);
            let reference = r.has(&format!("{key}.reference_world")).then(|| {
                r.direction(
                    &format!("{key}.reference_world"),
                    "direction that the sensor sees, in the world (east, north, up)",
                )
            });
            self.references.push(reference);
        }
    }

    /// Attitudes of another system, as motion capture sends them.
    fn read_pose(&mut self, r: &mut Reader<'_>, bag: &BagReader) {
        if !r.has("pose") {
            return;
        }
        let what = r.choice_or(
            "pose.use",
            "truth",
            &["truth", "directions"],
            "truth: the true attitude, to compare with; directions: measured, as two vector sensors (east and up)",
        );
        if what == "directions" {
            let first = self.references.len();
            self.references.extend([Vector3::x_axis(), Vector3::z_axis()].map(Some));
            self.add(r, "pose", Role::PoseDirections(first), bag);
            return;
        }
        if r.has("truth") {
            r.reject("pose.topic", "truth is given as well; allowed: one of the two, or use: directions");
        }
        self.add(r, "pose", Role::PoseTruth, bag);
    }

    /// Which joints of a message are the wheels.
    fn read_joints(&mut self, r: &mut Reader<'_>, channel: Channel) {
        let key = channel.info().topic_key;
        let is_state = channel == Channel::WheelSpeed;
        let joints = r.string_array_or(
            &format!("{key}.joints"),
            &[],
            if is_state {
                "names of the joints that are the wheels, in the order of the platform's parameters"
            } else {
                "names of the joints that are the wheels, in their order; left out: as in wheel_state"
            },
        );
        if !joints.is_empty() {
            self.joints.insert(channel, joints);
        }
        if is_state {
            self.effort_is_command = r.bool_or(
                &format!("{key}.effort_is_command"),
                false,
                "whether the efforts are the torques that were commanded, and not measured ones",
            );
        }
    }
}

fn topic(r: &mut Reader<'_>, key: &str, role: Role, bag: &BagReader) -> Option<String> {
    if !r.has(key) {
        return None;
    }
    let full = format!("{key}.topic");
    let name = r.string(&full, "full name of the topic");
    if name.is_empty() {
        return None;
    }
    let Some(topic) = bag.topic(&name) else {
        let present: Vec<&str> = bag.topics().iter().map(|topic| topic.name.as_str()).collect();
        let likely = or_did_you_mean(&name, present.iter().copied());
        let present = present.join(", ");
        r.reject(&full, format!("the bag has no such topic; it has: {}{likely}", or_none(&present)));
        return None;
    };
    if !fits(topic, role) {
        let given = match (topic.type_name.as_str(), topic.encoding.as_str()) {
            ("", "cdr") => "of a type that the recorder did not store".to_owned(),
            ("", "") => "of a type and an encoding that the recorder did not store".to_owned(),
            ("", encoding) => format!("encoded as {encoding}"),
            (name, "cdr") => name.to_owned(),
            (name, "") => format!("{name} in an encoding that the recorder did not store"),
            (name, encoding) => format!("{name}, encoded as {encoding}"),
        };
        r.reject(&full, format!("its messages are {given}; allowed: {}", allowed(role)));
        return None;
    }
    Some(name)
}

/// Messages of a type that was not stored are taken for what they are needed as; whether they are is seen when they are read.
fn fits(topic: &BagTopic, role: Role) -> bool {
    if topic.type_name.is_empty() {
        return topic.encoding == "cdr" && !role.is_pose();
    }
    if role.is_pose() {
        return topic.encoding == "cdr" && poses::TYPES.contains(&topic.type_name.as_str());
    }
    topic.message_type() == Some(role.message_type())
        || sees_direction(role) && topic.encoding == "cdr" && topic.type_name == MAGNETIC_FIELD
}

fn allowed(role: Role) -> String {
    if role.is_pose() {
        return poses::TYPES.join(", ");
    }
    let also = if sees_direction(role) { " or sensor_msgs/msg/MagneticField" } else { "" };
    format!("{}{also}", role.message_type().name())
}

fn sees_direction(role: Role) -> bool {
    matches!(role, Role::Measured(Channel::Vector, _))
}
