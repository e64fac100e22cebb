//! What devices tell.

use std::cell::Cell;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::time::Instant;

use nalgebra::Vector3;
use whorl_dynamics::actuators::Kind;

/// What a motor moves, at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joint {
    /// Index in its kind of actuator.
    pub index: usize,
    /// Angle \[rad\]; `None`: it is not measured, as of wheels.
    pub angle_rad: Option<f64>,
    /// Speed [rad/s].
    pub speed_rad_s: f64,
    /// Torque that the motor makes \[N m\].
    pub torque_n_m: f64,
}

/// A quantity of the platform, in SI units and body axes.
#[derive(Debug, Clone, PartialEq)]
pub enum Measured {
    /// Angular rate and specific force.
    Imu {
        /// Angular rate seen from the world, body axes [rad/s].
        rate_b_rad_s: Vector3<f64>,
        /// Specific force, body axes [m/s^2].
        specific_force_b_m_s2: Vector3<f64>,
    },
    /// Angular rate [rad/s] and specific force [m/s^2] along single axes, in the order of
    /// [`crate::Device::inertial_axes`].
    Axes {
        /// Angular rates.
        rate_rad_s: Vec<f64>,
        /// Specific forces.
        specific_force_m_s2: Vec<f64>,
    },
    /// Direction to the vector sensor's target, body axes; a unit vector.
    Direction(Vector3<f64>),
    /// The motors of one kind of actuator that one device drives, all of the same instant.
    Motors {
        /// Which kind.
        kind: Kind,
        /// What they move.
        motors: Vec<Joint>,
    },
    /// Valves that were switched at this instant: jet, and whether it is open now.
    Valves(Vec<(usize, bool)>),
    /// Whether the emergency stop is pressed.
    EmergencyStop(bool),
    /// Voltage of the power bus \[V\].
    BusVoltage(f64),
    /// Current that the platform draws from the power bus \[A\].
    BusCurrent(f64),
    /// Pressure in the tank \[Pa\].
    TankPressure(f64),
    /// Temperature \[K\].
    Temperature(f64),
}

/// State of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum State {
    /// It was not reached yet.
    Connecting,
    /// It answers.
    Ready,
    /// It answers, and says that something is wrong.
    Fault(String),
    /// It does not answer, or is not there. It is tried again.
    Lost(String),
}

/// A message of a device's thread.
#[derive(Debug, Clone, PartialEq)]
pub enum Reading {
    /// A measurement.
    Measured {
        /// Index in the list of devices.
        device: usize,
        /// When that was so.
        at: Instant,
        /// What.
        measured: Measured,
    },
    /// The device's state has changed.
    State {
        /// Index in the list of devices.
        device: usize,
        /// Now.
        state: State,
    },
    /// Bytes, messages or answers that were refused, since the last time.
    Refused {
        /// Index in the list of devices.
        device: usize,
        /// How many.
        count: u64,
    },
}

/// How a device's thread tells.
#[derive(Debug)]
pub struct Reporter {
    pub(crate) device: usize,
    pub(crate) readings: Sender<Reading>,
    /// A byte wakes whoever waits for readings.
    pub(crate) wake: UnixStream,
    /// The bus voltage measured last, as bits; NaN before. Drives without a current loop need it.
    pub(crate) bus_voltage_v: Arc<AtomicU64>,
    /// Whether the device's thread has told of a session.
    pub(crate) took_up: Cell<bool>,
}

impl Reporter {
    /// Tells a measurement.
    pub fn measured(&self, at: Instant, measured: Measured) {
        if let Measured::BusVoltage(volt) = measured {
            self.bus_voltage_v.store(volt.to_bits(), Ordering::Relaxed);
        }
        // Only what the control loop waits for wakes the node at once; the rest is taken along at its next tick.
        let urgent =
            matches!(measured, Measured::Imu { .. } | Measured::Axes { .. } | Measured::EmergencyStop(true));
        self.send(Reading::Measured { device: self.device, at, measured }, urgent);
    }

    /// Tells a new state.
    pub fn state(&self, state: State) {
        self.took_up.set(self.took_up.get() || state == State::Ready);
        self.send(Reading::State { device: self.device, state }, true);
    }

    /// Whether a session was begun since the last call.
    pub(crate) fn took_up(&self) -> bool {
        self.took_up.replace(false)
    }

    /// Tells that something was refused.
    pub fn refused(&self, count: u64) {
        if count > 0 {
            self.send(Reading::Refused { device: self.device, count }, false);
        }
    }

    /// The bus voltage measured last \[V\].
    #[must_use]
    pub fn bus_voltage_v(&self) -> Option<f64> {
        Some(f64::from_bits(self.bus_voltage_v.load(Ordering::Relaxed))).filter(|volt| volt.is_finite())
    }

    fn send(&self, reading: Reading, urgent: bool) {
        // Nobody listens any more when the node ends.
        if self.readings.send(reading).is_ok() && urgent {
            // A full pipe wakes just as well.
            let _ = (&self.wake).write(&[1]);
        }
    }
}
