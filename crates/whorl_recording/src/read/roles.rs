//! Roles of the topics of a bag.

use whorl_bag::{BagTopic, Channel, extra};
use whorl_msgs::{MessageType, Topic};

/// What a topic holds of a platform; some hold several things.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// A channel; sensors count from 0.
    Measured(Channel, usize),
    /// The direction of a vector sensor's target in the world.
    VectorReference(usize),
    /// Commands, from which torques and pulses follow.
    ActuatorCommand,
    /// Whether a controller is running.
    ControlStatus,
    /// The true attitude, in a message of another system.
    PoseTruth,
    /// An attitude of another system as two vector sensors, the first of this number, from 0.
    PoseDirections(usize),
}

impl Role {
    pub fn message_type(self) -> MessageType {
        match self {
            Self::Measured(channel, _) => channel.message_type(),
            Self::VectorReference(_) => MessageType::Vector3Stamped,
            Self::ActuatorCommand => MessageType::ActuatorCommand,
            Self::ControlStatus => MessageType::ControlStatus,
            Self::PoseTruth | Self::PoseDirections(_) => MessageType::PoseStamped,
        }
    }

    /// Whether its messages are of any of the types that hold an attitude.
    pub fn is_pose(self) -> bool {
        matches!(self, Self::PoseTruth | Self::PoseDirections(_))
    }

    /// Whether a platform exists that has only this.
    pub fn is_measured_motion(self) -> bool {
        matches!(self, Self::Measured(channel, _) if channel.info().is_motion)
    }

    /// Whether one sensor sends its messages: joints and commands come from several.
    pub fn is_one_sensor(self) -> bool {
        matches!(self, Self::Measured(Channel::Gyro | Channel::Accelerometer | Channel::Vector, _))
            || self.is_pose()
    }

    /// The roles of a topic by its name in the platform's namespace.
    fn of_name(name: &str) -> Vec<Self> {
        match Topic::find(name, true) {
            Some(Topic::ActuatorCommand) => return vec![Self::ActuatorCommand],
            Some(Topic::ControlStatus) => return vec![Self::ControlStatus],
            _ => {}
        }
        let carried = Channel::carried_by(name).into_iter();
        let references = (0..extra::MAX_VECTOR_SENSORS).filter(|n| extra::vector_reference(*n) == name);
        carried
            .map(|(channel, sensor)| Self::Measured(channel, sensor))
            .chain(references.map(Self::VectorReference))
            .collect()
    }
}

/// Platform and roles of a topic by Whorl's own names; `None` for others, and for one whose type is not the
/// role's.
pub(super) fn whorl_roles(topic: &BagTopic) -> Option<(&str, Vec<Role>)> {
    let (platform, name) = topic.name.strip_prefix('/')?.split_once('/')?;
    let mut roles = Role::of_name(name);
    roles.retain(|role| topic.message_type() == Some(role.message_type()));
    (!roles.is_empty()).then_some((platform, roles))
}
