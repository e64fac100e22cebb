//! How messages carry channels.

use whorl_math::CELSIUS_ZERO_K;
use whorl_msgs::geometry_msgs::{Quaternion, Vector3};
use whorl_msgs::sensor_msgs::{BatteryState, Imu};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Message, MessageType};

/// First element of a covariance that marks a missing measurement (`sensor_msgs/Imu`).
const NOT_MEASURED: f64 = -1.0;

/// A field of a message that holds the numbers of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// `sensor_msgs/Imu`, `angular_velocity` [rad/s].
    AngularVelocity,
    /// `sensor_msgs/Imu`, `linear_acceleration` [m/s^2].
    LinearAcceleration,
    /// `geometry_msgs/Vector3Stamped`.
    Vector,
    /// `sensor_msgs/JointState`, `position` \[rad\].
    JointPosition,
    /// `sensor_msgs/JointState`, `velocity` [rad/s].
    JointVelocity,
    /// `sensor_msgs/JointState`, `effort`.
    JointEffort,
    /// `sensor_msgs/BatteryState`, `voltage` \[V\], of 32 bits.
    Voltage,
    /// `sensor_msgs/FluidPressure` \[Pa\].
    FluidPressure,
    /// `sensor_msgs/Temperature`, degrees Celsius there, \[K\] here.
    Temperature,
    /// `whorl_msgs/AttitudeEstimate`, `q_world_body`.
    Attitude,
    /// `whorl_msgs/AttitudeEstimate`, `omega_wb_b_rad_s`.
    Rate,
    /// `whorl_msgs/ThrusterState`: states and on-times of valves, from which pulses follow.
    Valves,
}

impl Carrier {
    /// Type of the messages.
    #[must_use]
    pub fn message_type(self) -> MessageType {
        match self {
            Self::AngularVelocity | Self::LinearAcceleration => MessageType::Imu,
            Self::Vector => MessageType::Vector3Stamped,
            Self::JointPosition | Self::JointVelocity | Self::JointEffort => MessageType::JointState,
            Self::Voltage => MessageType::BatteryState,
            Self::FluidPressure => MessageType::FluidPressure,
            Self::Temperature => MessageType::Temperature,
            Self::Attitude | Self::Rate => MessageType::AttitudeEstimate,
            Self::Valves => MessageType::ThrusterState,
        }
    }

    /// The numbers in a message, finite or not, in SI units; `None` where it marks them as not measured, or
    /// is of another type.
    #[must_use]
    pub fn read(self, message: &Message) -> Option<Vec<f64>> {
        if self.marked_missing(message).is_some() {
            return None;
        }
        self.read_marked(message)
    }

    /// The field of a message that says that these numbers were not measured (`sensor_msgs/Imu`: -1 as the first element of their
    /// covariance); `None` where nothing says so.
    #[must_use]
    pub fn marked_missing(self, message: &Message) -> Option<&'static str> {
        let (field, covariance) = match (self, message) {
            (Self::AngularVelocity, Message::Imu(m)) => {
                ("angular_velocity_covariance", &m.angular_velocity_covariance)
            }
            (Self::LinearAcceleration, Message::Imu(m)) => {
                ("linear_acceleration_covariance", &m.linear_acceleration_covariance)
            }
            _ => return None,
        };
        (covariance.first() == Some(&NOT_MEASURED)).then_some(field)
    }

    /// As [`Self::read`], whatever the message says of its numbers.
    #[must_use]
    pub fn read_marked(self, message: &Message) -> Option<Vec<f64>> {
        let axes = |v: Vector3| Some(<[f64; 3]>::from(v).to_vec());
        let list = |values: &Vec<f64>| Some(values.clone()).filter(|values| !values.is_empty());
        match (self, message) {
            (Self::AngularVelocity, Message::Imu(m)) => axes(m.angular_velocity),
            (Self::LinearAcceleration, Message::Imu(m)) => axes(m.linear_acceleration),
            (Self::Vector, Message::Vector3Stamped(m)) => axes(m.vector),
            (Self::JointPosition, Message::JointState(m)) => list(&m.position),
            (Self::JointVelocity, Message::JointState(m)) => list(&m.velocity),
            (Self::JointEffort, Message::JointState(m)) => list(&m.effort),
            (Self::Voltage, Message::BatteryState(m)) => Some(vec![f64::from(m.voltage)]),
            (Self::FluidPressure, Message::FluidPressure(m)) => Some(vec![m.fluid_pressure]),
            (Self::Temperature, Message::Temperature(m)) => Some(vec![m.temperature + CELSIUS_ZERO_K]),
            (Self::Attitude, Message::AttitudeEstimate(m)) => {
                m.q_world_body.to_unit().map(|q| vec![q.w, q.i, q.j, q.k])
            }
            // A truth with attitudes only has no rates.
            (Self::Rate, Message::AttitudeEstimate(m)) => {
                axes(m.omega_wb_b_rad_s).filter(|rate| rate.iter().all(|x| x.is_finite()))
            }
            _ => None,
        }
    }

    /// Puts the numbers of a sample into a message; one of another type stays as it is.
    pub fn write(self, numbers: &[f64], message: &mut Message) {
        let axes = || match numbers {
            &[x, y, z] => Vector3 { x, y, z },
            _ => UNKNOWN,
        };
        let first = || numbers.first().copied().unwrap_or(f64::NAN);
        match (self, message) {
            (Self::AngularVelocity, Message::Imu(m)) => {
                m.angular_velocity = axes();
                m.angular_velocity_covariance = [0.0; 9];
            }
            (Self::LinearAcceleration, Message::Imu(m)) => {
                m.linear_acceleration = axes();
                m.linear_acceleration_covariance = [0.0; 9];
            }
            (Self::Vector, Message::Vector3Stamped(m)) => m.vector = axes(),
            (Self::JointPosition, Message::JointState(m)) => m.position = numbers.to_vec(),
            (Self::JointVelocity, Message::JointState(m)) => m.velocity = numbers.to_vec(),
            (Self::JointEffort, Message::JointState(m)) => m.effort = numbers.to_vec(),
            (Self::Voltage, Message::BatteryState(m)) => m.voltage = first() as f32,
            (Self::FluidPressure, Message::FluidPressure(m)) => m.fluid_pressure = first(),
            (Self::Temperature, Message::Temperature(m)) => m.temperature = first() - CELSIUS_ZERO_K,
            (Self::Attitude, Message::AttitudeEstimate(m)) => {
                if let &[w, x, y, z] = numbers {
                    m.q_world_body = Quaternion { x, y, z, w };
                }
            }
            (Self::Rate, Message::AttitudeEstimate(m)) => m.omega_wb_b_rad_s = axes(),
            _ => {}
        }
    }
}

const UNKNOWN: Vector3 = Vector3 { x: f64::NAN, y: f64::NAN, z: f64::NAN };

/// A message with all fields marked as not measured, to be filled by [`Carrier::write`].
#[must_use]
pub fn blank(message_type: MessageType, header: Header, sequence: u64) -> Message {
    let mut none = [0.0; 9];
    none[0] = NOT_MEASURED;
    let unknown = f32::NAN;
    match message_type {
        MessageType::Imu => Imu {
            header,
            orientation_covariance: none,
            angular_velocity: UNKNOWN,
            angular_velocity_covariance: none,
            linear_acceleration: UNKNOWN,
            linear_acceleration_covariance: none,
            ..Imu::default()
        }
        .into(),
        MessageType::BatteryState => BatteryState {
            header,
            voltage: unknown,
            temperature: unknown,
            current: unknown,
            charge: unknown,
            capacity: unknown,
            design_capacity: unknown,
            percentage: unknown,
            present: true,
            ..BatteryState::default()
        }
        .into(),
        MessageType::AttitudeEstimate => AttitudeEstimate {
            header,
            sequence,
            q_world_body: Quaternion { x: f64::NAN, y: f64::NAN, z: f64::NAN, w: f64::NAN },
            omega_wb_b_rad_s: UNKNOWN,
            gyro_bias_b_rad_s: UNKNOWN,
            nis: f64::NAN,
            health: AttitudeEstimate::HEALTH_OK,
            ..AttitudeEstimate::default()
        }
        .into(),
        other => {
            let mut message = Message::default_of(other);
            match &mut message {
                Message::Vector3Stamped(m) => (m.header, m.vector) = (header, UNKNOWN),
                Message::JointState(m) => m.header = header,
                Message::FluidPressure(m) => (m.header, m.fluid_pressure) = (header, f64::NAN),
                Message::Temperature(m) => (m.header, m.temperature) = (header, f64::NAN),
                _ => {}
            }
            message
        }
    }
}
