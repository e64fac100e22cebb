//! From a message of any type to the one that a topic carries.

use whorl_msgs::topics::Message;
use whorl_msgs::{diagnostic_msgs, geometry_msgs, sensor_msgs, tf2_msgs, whorl};

/// A type that a topic may carry.
pub trait Typed: Sized + 'static {
    /// The message itself, if it is of this type.
    fn of(message: &Message) -> Option<&Self>;
}

macro_rules! typed {
    ($($variant:ident $ty:ty;)+) => {
        $(impl Typed for $ty {
            fn of(message: &Message) -> Option<&Self> {
                match message {
                    Message::$variant(m) => Some(m),
                    _ => None,
                }
            }
        })+
    };
}

typed! {
    Imu sensor_msgs::Imu;
    Vector3Stamped geometry_msgs::Vector3Stamped;
    JointState sensor_msgs::JointState;
    ThrusterState whorl::ThrusterState;
    ActuatorCommand whorl::ActuatorCommand;
    AttitudeEstimate whorl::AttitudeEstimate;
    AttitudeReference whorl::AttitudeReference;
    ClockReply whorl::ClockReply;
    ClockRequest whorl::ClockRequest;
    ControlStatus whorl::ControlStatus;
    Excitation whorl::Excitation;
    FormationCommand whorl::FormationCommand;
    FormationState whorl::FormationState;
    GateState whorl::GateState;
    DiagnosticArray diagnostic_msgs::DiagnosticArray;
    TFMessage tf2_msgs::TFMessage;
}
