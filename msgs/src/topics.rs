//! The table of topics: name, type, namespace, quality of service. Shared by nodes, recorder,
//! simulation and replay.

use crate::cdr::{self, CdrError};
use crate::whorl::srv::StartExperimentResponse;

/// Index of a platform in the configured list of platform names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlatformId(pub u16);

/// A topic of one platform, or a shared one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Route {
    /// The platform for topics in a platform's namespace, `None` for shared ones.
    pub platform: Option<PlatformId>,
    /// Which topic.
    pub topic: Topic,
}

impl Route {
    /// A topic in a platform's namespace.
    #[must_use]
    pub fn platform(platform: PlatformId, topic: Topic) -> Self {
        Self { platform: Some(platform), topic }
    }

    /// A shared topic.
    #[must_use]
    pub fn shared(topic: Topic) -> Self {
        Self { platform: None, topic }
    }

    /// The full topic name, e.g. `/whorl_1/imu/data_raw`, given the platform names in the order
    /// of [`PlatformId`]. `None` when the platform is not in the list.
    #[must_use]
    pub fn name<S: AsRef<str>>(&self, platforms: &[S]) -> Option<String> {
        let name = self.topic.info().name;
        match self.platform {
            None => Some(format!("/{name}")),
            Some(id) => platforms.get(usize::from(id.0)).map(|p| format!("/{}/{name}", p.as_ref())),
        }
    }
}

/// How a topic is sent. Depth is the KeepLast history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Reliable or best effort. State and commands are best effort: after a cut, a reliable
    /// reader would first be served every missed, stale sample.
    pub reliable: bool,
    /// History depth.
    pub depth: u16,
}

const STREAM: Qos = Qos { reliable: false, depth: 10 };
const RARE: Qos = Qos { reliable: true, depth: 10 };

/// Row of a topic in the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TopicInfo {
    /// Name relative to the platform's namespace, or to `/` for a shared topic.
    pub name: &'static str,
    /// Whether it is in every platform's namespace.
    pub per_platform: bool,
    /// Type of its messages.
    pub message_type: MessageType,
    /// How it is sent.
    pub qos: Qos,
    /// Usual rate \[Hz\], for gap detection and documentation.
    pub rate_hz: f64,
}

macro_rules! messages {
    ($($variant:ident($ty:ty) $name:literal;)+) => {
        /// A message of any type that has a definition.
        #[derive(Debug, Clone, PartialEq)]
        #[cfg_attr(test, derive(serde::Serialize))]
        #[allow(missing_docs)]
        pub enum Message { $($variant($ty)),+ }

        /// The types that have a definition.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[allow(missing_docs)]
        pub enum MessageType { $($variant),+ }

        impl MessageType {
            /// Every type.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// ROS name, `package/msg/Type`.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
        }

        impl Message {
            /// The message's type.
            #[must_use]
            pub fn message_type(&self) -> MessageType {
                match self { $(Self::$variant(_) => MessageType::$variant),+ }
            }

            /// Encodes as CDR with its 4-byte header, into a buffer that keeps its memory.
            ///
            /// # Errors
            /// When a length exceeds 32 bits.
            pub fn encode_into(&self, bytes: &mut Vec<u8>) -> Result<(), CdrError> {
                match self { $(Self::$variant(m) => cdr::encode_into($name, m, bytes)),+ }
            }

            /// Decodes CDR with its 4-byte header.
            ///
            /// # Errors
            /// When the bytes are not CDR or not of that type.
            pub fn decode(message_type: MessageType, bytes: &[u8]) -> Result<Self, CdrError> {
                match message_type {
                    $(MessageType::$variant => cdr::decode::<$ty>($name, bytes).map(Self::$variant)),+
                }
            }

            /// Shows a visitor every field of the message.
            pub fn walk(&mut self, visitor: &mut dyn crate::fields::Visitor) {
                match self { $(Self::$variant(m) => crate::fields::Fields::walk(m, "", visitor)),+ }
            }

            /// A message of that type with every field at its default.
            #[must_use]
            pub fn default_of(message_type: MessageType) -> Self {
                match message_type { $(MessageType::$variant => Self::$variant(Default::default())),+ }
            }
        }

        $(impl From<$ty> for Message {
            fn from(message: $ty) -> Self { Self::$variant(message) }
        })+
    };
}

include!(concat!(env!("OUT_DIR"), "/messages.rs"));

macro_rules! topics {
    ($($(#[$doc:meta])* $topic:ident $name:literal $scope:ident $ty:ident $qos:ident $rate:literal;)+) => {
        /// The topics.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Topic { $($(#[$doc])* $topic),+ }

        impl Topic {
            /// Every topic.
            pub const ALL: &[Self] = &[$(Self::$topic),+];

            /// Its row in the table.
            #[must_use]
            pub fn info(self) -> TopicInfo {
                match self {
                    $(Self::$topic => TopicInfo {
                        name: $name,
                        per_platform: topics!(@scope $scope),
                        message_type: MessageType::$ty,
                        qos: $qos,
                        rate_hz: $rate,
                    }),+
                }
            }
        }
    };
    (@scope platform) => { true };
    (@scope shared) => { false };
}

topics! {
    /// Gyro: angular rate \[rad/s\]; accelerometer: specific force \[m/s^2\], +9.81 on z at rest (REP-145). There is
    /// no orientation: `orientation_covariance[0]` is -1. From the driver.
    ImuRaw "imu/data_raw" platform Imu STREAM 100.0;
    /// Direction to the vector sensor's target in body axes, from the driver.
    VectorDirection "vector_sensor/direction" platform Vector3Stamped STREAM 10.0;
    /// Wheels: `velocity` is the speed \[rad/s\], `effort` the motor torque \[N m\]. From the driver.
    WheelState "wheels/state" platform JointState STREAM 100.0;
    /// Gimbals of control moment gyros: `position` is the angle \[rad\], `velocity` the rate \[rad/s\], `effort` the
    /// motor torque \[N m\]. From the driver, of platforms that have them.
    GimbalState "gimbals/state" platform JointState STREAM 100.0;
    /// Valve on-times, from the driver.
    ThrusterState "thrusters/state" platform ThrusterState STREAM 100.0;
    /// Bus voltage \[V\], from the driver.
    Battery "battery" platform BatteryState STREAM 10.0;
    /// Absolute tank pressure \[Pa\], from the driver.
    TankPressure "tank_pressure" platform FluidPressure STREAM 10.0;
    /// Platform temperature in degrees Celsius, from the driver.
    Temperature "temperature" platform Temperature STREAM 1.0;
    /// Wheel torques, gimbal rates and jet on-times, from local control.
    ActuatorCommand "actuators/command" platform ActuatorCommand STREAM 100.0;
    /// What the driver's gate made of them, from the driver.
    GateState "actuators/gate" platform GateState STREAM 10.0;
    /// From the estimator.
    AttitudeEstimate "attitude/estimate" platform AttitudeEstimate STREAM 100.0;
    /// Mass properties, from an estimator that identifies while the platform moves.
    ParameterEstimate "parameters/estimate" platform ParameterEstimate STREAM 1.0;
    /// Whether the platform moves as its model says, from the model monitor.
    ModelFit "model/fit" platform ModelFit STREAM 1.0;
    /// From the coordinator.
    AttitudeReference "attitude/reference" platform AttitudeReference STREAM 50.0;
    /// From local control.
    ControlStatus "control/status" platform ControlStatus STREAM 50.0;
    /// Which of its own excitations a platform plays, from the coordinator.
    Excitation "control/excitation" platform Excitation STREAM 50.0;
    /// From simulated hardware.
    TruthState "truth/state" platform AttitudeEstimate STREAM 100.0;
    /// Phase, errors, links, from the coordinator.
    FormationState "formation/state" shared FormationState STREAM 10.0;
    /// Authority heartbeat, from the coordinator.
    FormationCommand "formation/command" shared FormationCommand STREAM 20.0;
    /// Requests the time of every platform's computer and gives the estimated offsets, from the coordinator.
    FormationClock "formation/clock" shared ClockRequest STREAM 2.0;
    /// The time of the platform's computer, from local control.
    Clock "clock" platform ClockReply STREAM 2.0;
    /// From every node.
    Diagnostics "diagnostics" shared DiagnosticArray RARE 1.0;
    /// Frames `<platform>/base_link` in `world`, from the estimators.
    Tf "tf" shared TFMessage RARE 20.0;
    /// Moment that the linear mass actuators must add to the gravity offset, body axes \[N m\], from local
    /// control while it balances the platform; holds until the next.
    BallastMoment "ballast/moment" platform Vector3Stamped STREAM 1.0;
}

impl Topic {
    /// Measurements that a driver publishes.
    pub const FROM_DRIVER: [Self; 9] = [
        Self::ImuRaw,
        Self::VectorDirection,
        Self::WheelState,
        Self::GimbalState,
        Self::ThrusterState,
        Self::Battery,
        Self::TankPressure,
        Self::Temperature,
        Self::TruthState,
    ];

    /// Whether one node alone may write it: commands, references and estimates, by which a platform moves.
    #[must_use]
    pub fn has_one_publisher(self) -> bool {
        matches!(
            self,
            Self::ActuatorCommand
                | Self::BallastMoment
                | Self::AttitudeReference
                | Self::Excitation
                | Self::AttitudeEstimate
        )
    }

    /// The topic with this name relative to its namespace.
    #[must_use]
    pub fn find(name: &str, per_platform: bool) -> Option<Self> {
        Self::ALL.iter().copied().find(|t| t.info().name == name && t.info().per_platform == per_platform)
    }
}

/// Response of both services of the coordinator: success and a sentence.
pub type ExperimentResponse = StartExperimentResponse;

/// Services of the coordinator. Each takes one string and answers with an [`ExperimentResponse`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Service {
    /// `whorl_msgs/srv/StartExperiment` on `/coordinator/start`.
    StartExperiment,
    /// `whorl_msgs/srv/AbortExperiment` on `/coordinator/abort`.
    AbortExperiment,
    /// `whorl_msgs/srv/HoldExperiment` on `/coordinator/hold`.
    HoldExperiment,
}

impl Service {
    /// Every service.
    pub const ALL: [Self; 3] = [Self::StartExperiment, Self::AbortExperiment, Self::HoldExperiment];

    /// ROS name of its type.
    #[must_use]
    pub fn type_name(self) -> &'static str {
        match self {
            Self::StartExperiment => "whorl_msgs/srv/StartExperiment",
            Self::AbortExperiment => "whorl_msgs/srv/AbortExperiment",
            Self::HoldExperiment => "whorl_msgs/srv/HoldExperiment",
        }
    }

    /// Absolute service name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::StartExperiment => "/coordinator/start",
            Self::AbortExperiment => "/coordinator/abort",
            Self::HoldExperiment => "/coordinator/hold",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definitions;

    #[test]
    fn every_type_has_a_definition_and_its_default_survives_cdr() {
        for &message_type in MessageType::ALL {
            assert!(definitions::find(message_type.name()).is_some(), "{}", message_type.name());
            let message = Message::default_of(message_type);
            let mut bytes = Vec::new();
            message.encode_into(&mut bytes).unwrap();
            assert_eq!(Message::decode(message_type, &bytes).unwrap(), message);
            assert!(Message::decode(message_type, &bytes[..3]).is_err());
        }
    }

    #[test]
    fn imu_has_the_size_that_the_cdr_rules_give() {
        // Header 8 + (length 4 + terminator 1 -> 5), aligned to 16; 4+9+3+9+3+9 doubles; 4 bytes of CDR header.
        let mut bytes = Vec::new();
        Message::default_of(MessageType::Imu).encode_into(&mut bytes).unwrap();
        assert_eq!(bytes.len(), 4 + 16 + 37 * 8);
    }

    #[test]
    fn names_are_composed_from_platform_and_table() {
        let platforms = ["whorl_1", "whorl_2"];
        let route = Route::platform(PlatformId(1), Topic::AttitudeEstimate);
        assert_eq!(route.name(&platforms).as_deref(), Some("/whorl_2/attitude/estimate"));
        assert_eq!(Route::shared(Topic::Tf).name(&platforms).as_deref(), Some("/tf"));
        assert_eq!(Route::platform(PlatformId(2), Topic::ImuRaw).name(&platforms), None);
        assert_eq!(Topic::find("imu/data_raw", true), Some(Topic::ImuRaw));
    }
}
