//! Which topic of a bag holds what.

use whorl_bag::BagTopic;
use whorl_msgs::{MessageType, Topic};

/// What a topic holds of a platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Role {
    Imu,
    WheelState,
    /// Motor torques in force from the stamp on (imported recordings).
    WheelCommand,
    Thrusters,
    ActuatorCommand,
    ControlStatus,
    /// Vector sensors count from 0.
    Vector(usize),
    /// The direction of a vector sensor's target in the world.
    VectorReference(usize),
    BusVoltage,
    TankPressure,
    Temperature,
    BodyTorque,
    BallastMoment,
    Truth,
}

impl Role {
    pub fn message_type(self) -> MessageType {
        match self {
            Self::Imu => MessageType::Imu,
            Self::WheelState | Self::WheelCommand => MessageType::JointState,
            Self::Thrusters => MessageType::ThrusterState,
            Self::ActuatorCommand => MessageType::ActuatorCommand,
            Self::ControlStatus => MessageType::ControlStatus,
            Self::Vector(_) | Self::VectorReference(_) | Self::BodyTorque | Self::BallastMoment => {
                MessageType::Vector3Stamped
            }
            Self::BusVoltage => MessageType::BatteryState,
            Self::TankPressure => MessageType::FluidPressure,
            Self::Temperature => MessageType::Temperature,
            Self::Truth => MessageType::AttitudeEstimate,
        }
    }

    /// Whether a platform exists that has only this.
    pub fn is_measured_motion(self) -> bool {
        matches!(self, Self::Imu | Self::WheelState)
    }

    /// The role of a topic by its name in the platform's namespace.
    pub fn of_name(name: &str) -> Option<Self> {
        if let Some(topic) = Topic::find(name, true) {
            return match topic {
                Topic::ImuRaw => Some(Self::Imu),
                Topic::WheelState => Some(Self::WheelState),
                Topic::ThrusterState => Some(Self::Thrusters),
                Topic::ActuatorCommand => Some(Self::ActuatorCommand),
                Topic::ControlStatus => Some(Self::ControlStatus),
                Topic::VectorDirection => Some(Self::Vector(0)),
                Topic::Battery => Some(Self::BusVoltage),
                Topic::TankPressure => Some(Self::TankPressure),
                Topic::Temperature => Some(Self::Temperature),
                Topic::TruthState => Some(Self::Truth),
                Topic::BallastMoment => Some(Self::BallastMoment),
                _ => None,
            };
        }
        match name {
            whorl_bag::extra::WHEEL_COMMAND => return Some(Self::WheelCommand),
            whorl_bag::extra::BODY_TORQUE => return Some(Self::BodyTorque),
            _ => {}
        }
        let sensor = |n: usize| whorl_bag::extra::vector_direction(n) == name;
        let reference = |n: usize| whorl_bag::extra::vector_reference(n) == name;
        (0..whorl_bag::extra::MAX_VECTOR_SENSORS).find_map(|n| {
            if sensor(n) { Some(Self::Vector(n)) } else { reference(n).then_some(Self::VectorReference(n)) }
        })
    }
}

/// Platform and role of a topic by Whorl's own names; `None` for others, and for one whose type is not the
/// role's.
pub(super) fn whorl_role(topic: &BagTopic) -> Option<(&str, Role)> {
    let (platform, name) = topic.name.strip_prefix('/')?.split_once('/')?;
    let role = Role::of_name(name)?;
    (topic.message_type() == Some(role.message_type())).then_some((platform, role))
}
