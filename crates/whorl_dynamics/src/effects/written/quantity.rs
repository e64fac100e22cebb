//! What an equation may name: measured and commanded quantities, with unit and axes.

use super::units::Dimension;
use crate::Environment;

/// Where a vector's components are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axes {
    /// Of the body.
    Body,
    /// Of the world: the room, z up.
    World,
}

/// A named quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Name in equations.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Scalar, vector in body axes, or one of each wheel or valve (`motor_torque[1]`).
    pub form: QuantityForm,
    read: Read,
}

/// How many numbers a quantity is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QuantityForm {
    /// One number.
    Scalar,
    /// Three, in body axes.
    Vector,
    /// One of each wheel or valve, by number from 1.
    Indexed,
}

/// One number of an environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Read {
    Rate(u8),
    Acceleration(u8),
    Vertical(u8),
    Rotation(u8, u8),
    WheelMomentum(u8),
    Ballast(u8),
    Heading,
    Tilt,
    WheelSpeed(u8),
    MotorTorque(u8),
    OwnSpeed,
    OwnMotorTorque,
    Valve(u8),
    Pressure,
    FullPressure,
    GasUsed,
    Voltage,
    FullVoltage,
    Temperature,
    AmbientTemperature,
    Time,
}

const fn row(
    name: &'static str,
    unit: &'static str,
    form: QuantityForm,
    read: Read,
    meaning: &'static str,
) -> Quantity {
    Quantity { name, unit, meaning, form, read }
}

/// Every quantity that an equation may name.
pub const QUANTITIES: &[Quantity] = &[
    row("rate", "rad/s", QuantityForm::Vector, Read::Rate(0), "rate of the body seen from the world"),
    row(
        "acceleration",
        "rad/s^2",
        QuantityForm::Vector,
        Read::Acceleration(0),
        "its derivative; known where sensors and hidden states are computed, zero in torques",
    ),
    row("vertical", "1", QuantityForm::Vector, Read::Vertical(0), "the vertical, a unit vector upwards"),
    row(
        "heading",
        "rad",
        QuantityForm::Scalar,
        Read::Heading,
        "angle of body x about the vertical, -pi to pi",
    ),
    row("tilt", "rad", QuantityForm::Scalar, Read::Tilt, "angle between body z and the vertical"),
    row(
        "wheel_momentum",
        "N m s",
        QuantityForm::Vector,
        Read::WheelMomentum(0),
        "angular momentum of the wheels relative to the body",
    ),
    row(
        "wheel_speed",
        "rad/s",
        QuantityForm::Indexed,
        Read::WheelSpeed(0),
        "speed of wheel n relative to the body",
    ),
    row("motor_torque", "N m", QuantityForm::Indexed, Read::MotorTorque(0), "torque of the motor of wheel n"),
    row(
        "valve",
        "1",
        QuantityForm::Indexed,
        Read::Valve(0),
        "share of valve n's flow that passes now, 0 to 1",
    ),
    row(
        "speed",
        "rad/s",
        QuantityForm::Scalar,
        Read::OwnSpeed,
        "speed of the wheel that the equation is applied to; in wheel torques only",
    ),
    row(
        "drive",
        "N m",
        QuantityForm::Scalar,
        Read::OwnMotorTorque,
        "motor torque of that wheel; in wheel torques only",
    ),
    row("pressure", "Pa", QuantityForm::Scalar, Read::Pressure, "tank pressure"),
    row(
        "reference_pressure",
        "Pa",
        QuantityForm::Scalar,
        Read::FullPressure,
        "tank pressure at which jets give their nominal thrust",
    ),
    row("gas_used", "kg", QuantityForm::Scalar, Read::GasUsed, "gas used since the tank was full"),
    row("voltage", "V", QuantityForm::Scalar, Read::Voltage, "bus voltage"),
    row(
        "initial_voltage",
        "V",
        QuantityForm::Scalar,
        Read::FullVoltage,
        "bus voltage of the model at the start of a run",
    ),
    row("temperature", "K", QuantityForm::Scalar, Read::Temperature, "temperature of the platform"),
    row(
        "ambient_temperature",
        "K",
        QuantityForm::Scalar,
        Read::AmbientTemperature,
        "temperature at which the sensors were calibrated",
    ),
    row("time", "s", QuantityForm::Scalar, Read::Time, "time since the start of the run"),
    row(
        "ballast",
        "1",
        QuantityForm::Vector,
        Read::Ballast(0),
        "sense of the last travel of the linear mass actuators: -1, 0, 1",
    ),
];

impl Quantity {
    /// The dimension of its unit.
    pub(super) fn dimension(&self) -> Dimension {
        Dimension::parse(self.unit).map_or(Dimension::NONE, |(dimension, _)| dimension)
    }

    /// What is read for its component, or for wheel or valve `index` from 0.
    pub(super) fn reads(&self, index: u8) -> Read {
        match self.read {
            Read::Rate(_) => Read::Rate(index),
            Read::Acceleration(_) => Read::Acceleration(index),
            Read::Vertical(_) => Read::Vertical(index),
            Read::WheelMomentum(_) => Read::WheelMomentum(index),
            Read::Ballast(_) => Read::Ballast(index),
            Read::WheelSpeed(_) => Read::WheelSpeed(index),
            Read::MotorTorque(_) => Read::MotorTorque(index),
            Read::Valve(_) => Read::Valve(index),
            other => other,
        }
    }
}

impl Read {
    /// The number, of `wheel` where it is the wheel's own.
    #[inline]
    pub(super) fn of(self, environment: &Environment<'_>, wheel: usize) -> f64 {
        let at = |v: &nalgebra::Vector3<f64>, i: u8| match i {
            0 => v.x,
            1 => v.y,
            _ => v.z,
        };
        match self {
            Self::Rate(i) => at(&environment.omega_wb_b_rad_s, i),
            Self::Acceleration(i) => at(&environment.omega_dot_wb_b_rad_s2, i),
            Self::Vertical(i) => at(&environment.vertical_b, i),
            Self::Rotation(row, column) => {
                let mut e = nalgebra::Vector3::zeros();
                e[usize::from(column.min(2))] = 1.0;
                at(&environment.q_world_body.transform_vector(&e), row)
            }
            Self::WheelMomentum(i) => {
                let wheels = environment.model.wheels().iter().enumerate();
                let own = |(j, wheel): (usize, &crate::platform::Wheel)| {
                    wheel.spin_inertia_kg_m2 * environment.wheel_speed(j) * at(&wheel.spin_axis_b, i)
                };
                wheels.map(own).sum()
            }
            Self::Ballast(i) => at(&environment.ballast_direction, i),
            Self::Heading => environment.yaw_rad(),
            Self::Tilt => {
                environment.vertical_b.x.hypot(environment.vertical_b.y).atan2(environment.vertical_b.z)
            }
            Self::WheelSpeed(j) => environment.wheel_speed(usize::from(j)),
            Self::MotorTorque(j) => environment.wheel_motor_torque(usize::from(j)),
            Self::OwnSpeed => environment.wheel_speed(wheel),
            Self::OwnMotorTorque => environment.wheel_motor_torque(wheel),
            Self::Valve(j) => environment.valve_fraction.get(usize::from(j)).copied().unwrap_or(0.0),
            Self::Pressure => environment.tank_pressure_pa,
            Self::FullPressure => environment.model.tank().reference_pressure_pa,
            Self::GasUsed => environment.gas_used_kg,
            Self::Voltage => environment.bus_voltage_v,
            Self::FullVoltage => environment.model.bus.initial_v,
            Self::Temperature => environment.temperature_k,
            Self::AmbientTemperature => environment.model.sensors.ambient_temperature_k,
            Self::Time => environment.time_s,
        }
    }
}
