//! One row for each channel.

use whorl_msgs::Topic;

use super::Carrier;
use crate::extra;
use crate::units::{self, Unit};

/// What the numbers of one sample are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Components along x, y, z of the body.
    Axes,
    /// One for each wheel, in the order of the platform's wheels.
    Wheels {
        /// What a wheel's number is called behind the wheel's name.
        each: &'static str,
    },
    /// One for each control moment gyro, in the order of the platform's gyros.
    Gimbals {
        /// What a gimbal's number is called behind its name.
        each: &'static str,
    },
    /// One.
    Scalar,
    /// Components along x, y, z of the body of a direction that is fixed in the world; a platform may have several
    /// such sensors.
    Directions,
    /// w, x, y, z of the quaternion of the attitude, v_world = q v_body.
    Attitude,
    /// Pulses of each jet, no samples.
    Pulses,
}

/// Where recordings have a channel, in the platform's namespace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A topic that nodes send.
    Topic(Topic),
    /// One that only recordings have.
    Extra(&'static str),
    /// [`extra::vector_direction`] of each sensor.
    Sensor,
}

/// The row of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelInfo {
    /// Its key in maps of columns, and its name.
    pub key: &'static str,
    /// What it is, in the words of a parameter's description.
    pub holds: &'static str,
    /// What the numbers of a sample are.
    pub form: Form,
    /// Units of columns, the SI unit first.
    pub units: &'static [Unit],
    /// The unit in which it is shown to people, if not the SI unit.
    pub shown_unit: Option<&'static str>,
    /// Stem and end of the columns that an export writes; between them stands the axis. Wheels and jets have their
    /// names for a stem.
    pub column: (&'static str, &'static str),
    /// Where recordings have it.
    pub place: Place,
    /// Key of its topic in a map of topics; channels of one message share it.
    pub topic_key: &'static str,
    /// How messages carry it.
    pub carrier: Carrier,
    /// Whether a sample holds until the next, as commands do.
    pub is_held: bool,
    /// Whether it measures motion: a recording needs at least one such channel.
    pub is_motion: bool,
    /// Whether a sensor of it may have fewer than three axes.
    pub may_lack_axes: bool,
    /// Spread below which it counts as constant when residuals are correlated with it; `None`: not used, because the
    /// smoothed motion gives the same information with less noise.
    pub resolution: Option<f64>,
}

impl ChannelInfo {
    /// What stands for an axis without a column: a sensor does not measure it, and what acts does not act about it. `None`: all three
    /// are needed.
    #[must_use]
    pub fn absent_axis(&self) -> Option<f64> {
        if self.may_lack_axes {
            Some(f64::NAN)
        } else {
            (self.is_held && self.form == Form::Axes).then_some(0.0)
        }
    }
}

/// What most rows have.
const ROW: ChannelInfo = ChannelInfo {
    key: "",
    holds: "",
    form: Form::Scalar,
    units: &[],
    shown_unit: None,
    column: ("", ""),
    place: Place::Sensor,
    topic_key: "",
    carrier: Carrier::Vector,
    is_held: false,
    is_motion: false,
    may_lack_axes: false,
    resolution: None,
};

macro_rules! channels {
    ($($(#[$doc:meta])* $channel:ident { $($field:ident: $value:expr),+ $(,)? })+) => {
        /// A quantity that is measured of a platform, or known to act on it.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Channel { $($(#[$doc])* $channel),+ }

        impl Channel {
            /// Every channel, in the order of exported columns.
            pub const ALL: &[Self] = &[$(Self::$channel),+];

            /// Its row in the table.
            #[must_use]
            pub fn info(self) -> &'static ChannelInfo {
                match self {
                    $(Self::$channel => const { &ChannelInfo { $($field: $value,)+ ..ROW } }),+
                }
            }
        }
    };
}

channels! {
    /// Rate gyro, body axes [rad/s].
    Gyro {
        key: "gyro",
        holds: "rate about x, y, z of the body, right-handed",
        form: Form::Axes,
        units: units::RATE,
        shown_unit: Some("deg/s"),
        column: ("gyro", "_rad_s"),
        place: Place::Topic(Topic::ImuRaw),
        topic_key: "imu",
        carrier: Carrier::AngularVelocity,
        is_motion: true,
        may_lack_axes: true,
    }
    /// Accelerometer: specific force, body axes [m/s^2], +9.81 on z at rest.
    Accelerometer {
        key: "accelerometer",
        holds: "specific force along x, y, z of the body, positive on z at rest",
        form: Form::Axes,
        units: units::SPECIFIC_FORCE,
        column: ("force", "_m_s2"),
        place: Place::Topic(Topic::ImuRaw),
        topic_key: "imu",
        carrier: Carrier::LinearAcceleration,
        is_motion: true,
        may_lack_axes: true,
    }
    /// Vector sensors: directions in body axes. Their unit does not matter; errors of a direction are angles \[rad\].
    Vector {
        key: "vector",
        holds: "direction along x, y, z of the body, of any length",
        form: Form::Directions,
        units: units::ANGLE,
        shown_unit: Some("deg"),
        column: ("vector", ""),
        place: Place::Sensor,
        topic_key: "vector",
        carrier: Carrier::Vector,
    }
    /// Wheel speeds relative to the body [rad/s].
    WheelSpeed {
        key: "wheel_speed",
        holds: "speed of each wheel relative to the body",
        form: Form::Wheels { each: "speed" },
        units: units::WHEEL_SPEED,
        column: ("wheel", "_rad_s"),
        place: Place::Topic(Topic::WheelState),
        topic_key: "wheel_state",
        carrier: Carrier::JointVelocity,
        is_motion: true,
        resolution: Some(0.5),
    }
    /// Motor torques in force [N m].
    WheelTorqueCommand {
        key: "wheel_torque_command",
        holds: "commanded motor torque of each wheel",
        form: Form::Wheels { each: "torque" },
        units: units::TORQUE,
        column: ("wheel", "_n_m"),
        place: Place::Extra(extra::WHEEL_COMMAND),
        topic_key: "wheel_torque_command",
        carrier: Carrier::JointEffort,
        is_held: true,
        resolution: Some(1e-3),
    }
    /// Measured currents of the wheels' motors \[A\], positive where the torque is.
    WheelCurrent {
        key: "wheel_current",
        holds: "current of each wheel's motor, positive where its torque is",
        form: Form::Wheels { each: "current" },
        units: units::CURRENT,
        column: ("wheel", "_a"),
        place: Place::Extra("wheels/current"),
        topic_key: "wheel_current",
        carrier: Carrier::JointEffort,
        resolution: Some(0.01),
    }
    /// Gimbal angles of control moment gyros \[rad\].
    GimbalAngle {
        key: "gimbal_angle",
        holds: "angle of each control moment gyro's gimbal, right-handed about its axis",
        form: Form::Gimbals { each: "angle" },
        units: units::ANGLE,
        column: ("gimbal", "_rad"),
        place: Place::Topic(Topic::GimbalState),
        topic_key: "gimbal_state",
        carrier: Carrier::JointPosition,
    }
    /// Gimbal rates [rad/s].
    GimbalRate {
        key: "gimbal_rate",
        holds: "rate of each control moment gyro's gimbal",
        form: Form::Gimbals { each: "rate" },
        units: units::RATE,
        column: ("gimbal", "_rad_s"),
        place: Place::Topic(Topic::GimbalState),
        topic_key: "gimbal_state",
        carrier: Carrier::JointVelocity,
    }
    /// Torques of the gimbals' motors [N m].
    GimbalTorque {
        key: "gimbal_torque",
        holds: "torque of each gimbal's motor about its axis",
        form: Form::Gimbals { each: "torque" },
        units: units::TORQUE,
        column: ("gimbal", "_n_m"),
        place: Place::Topic(Topic::GimbalState),
        topic_key: "gimbal_state",
        carrier: Carrier::JointEffort,
    }
    /// Commanded pulses of each jet \[s\].
    Jets {
        key: "jets",
        holds: "command of each jet",
        form: Form::Pulses,
        units: units::ON_TIME,
        column: ("jet", "_on_s"),
        place: Place::Topic(Topic::ThrusterState),
        topic_key: "thrusters",
        carrier: Carrier::Valves,
        is_held: true,
    }
    /// Known torque on the body from other actuators, body axes [N m].
    BodyTorque {
        key: "body_torque",
        holds: "known torque on the body about the centre of rotation, body axes",
        form: Form::Axes,
        units: units::TORQUE,
        column: ("body_torque", "_n_m"),
        place: Place::Extra(extra::BODY_TORQUE),
        topic_key: "body_torque",
        carrier: Carrier::Vector,
        is_held: true,
    }
    /// Commanded moment of the linear mass actuators, body axes [N m].
    BallastMoment {
        key: "ballast_moment",
        holds: "weight times displacement of the linear mass actuators, body axes",
        form: Form::Axes,
        units: units::TORQUE,
        column: ("ballast_moment", "_n_m"),
        place: Place::Topic(Topic::BallastMoment),
        topic_key: "ballast_moment",
        carrier: Carrier::Vector,
        is_held: true,
    }
    /// Bus voltage \[V\].
    BusVoltage {
        key: "bus_voltage",
        holds: "bus voltage",
        units: units::VOLTAGE,
        column: ("bus", "_v"),
        place: Place::Topic(Topic::Battery),
        topic_key: "bus_voltage",
        carrier: Carrier::Voltage,
        resolution: Some(0.05),
    }
    /// Tank pressure \[Pa\].
    TankPressure {
        key: "tank_pressure",
        holds: "tank pressure",
        units: units::PRESSURE,
        column: ("tank", "_pa"),
        place: Place::Topic(Topic::TankPressure),
        topic_key: "tank_pressure",
        carrier: Carrier::FluidPressure,
        resolution: Some(1e5),
    }
    /// Temperature of the platform \[K\].
    Temperature {
        key: "temperature",
        holds: "temperature of the platform",
        units: units::TEMPERATURE,
        column: ("temperature", "_k"),
        place: Place::Topic(Topic::Temperature),
        topic_key: "temperature",
        carrier: Carrier::Temperature,
        resolution: Some(0.3),
    }
    /// True attitude, v_world = q v_body, where it is known.
    TrueAttitude {
        key: "true_attitude",
        holds: "w, x, y, z of the true attitude quaternion (Hamilton)",
        form: Form::Attitude,
        column: ("true_q", ""),
        place: Place::Topic(Topic::TruthState),
        topic_key: "truth",
        carrier: Carrier::Attitude,
    }
    /// True body rate, body axes [rad/s], where it is known.
    TrueRate {
        key: "true_rate",
        holds: "true rate of the body seen from the world",
        form: Form::Axes,
        units: units::RATE,
        column: ("true_rate", "_rad_s"),
        place: Place::Topic(Topic::TruthState),
        topic_key: "truth",
        carrier: Carrier::Rate,
    }
}
