//! ODrive motor controllers on a CAN bus, with reaction wheels on their motors.
//!
//! Every cycle is a torque or a speed for each controller, and a request that it answers with its speed. State and errors come
//! with its heartbeats. Limits, calibration and the watchdog are the controller's own, set with the maker's program.

mod emulator;
pub mod protocol;
mod session;
#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_params::Reader;

use crate::DeviceError;
use crate::can_motors::{CanMotors, Traits, run};
use crate::device::{Address, Device, DeviceKind, Role, Wrong};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
use protocol::{Message, identifier};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "odrive_motors",
    what: "ODrive motor controllers on a CAN bus (CANSimple): reaction wheels",
    read,
};

const TRAITS: Traits = Traits {
    nodes: 0..=protocol::LARGEST_NODE as i64,
    // Speed and torque; the request; its answer.
    cycle: &[8, 0, 8],
    watchdog: "controllers switch off so long after the last message [s], as axis0.config.watchdog_timeout; 0: they do not",
    shortest_watchdog_s: 0.05,
};

/// Controllers of one bus.
#[derive(Debug, Clone)]
struct Controllers {
    motors: CanMotors,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let motors = CanMotors::read(r, model, &TRAITS)?;
    Some(Box::new(Controllers { motors }))
}

impl Controllers {
    /// What controllers send.
    fn heard(&self) -> Vec<u16> {
        let messages = [Message::Heartbeat, Message::GetEncoderEstimates];
        let nodes = self.motors.motors.iter().map(|motor| motor.node);
        nodes.flat_map(|node| messages.map(|message| identifier(message, node))).collect()
    }
}

impl Device for Controllers {
    fn addresses(&self) -> Vec<Address> {
        let nodes = self.motors.motors.iter().map(|motor| motor.node);
        self.motors
            .bus
            .addresses(nodes.flat_map(|node| Message::ALL.map(|message| identifier(message, node))))
    }

    fn host(&self) -> Option<&str> {
        self.motors.bus.host()
    }

    fn inspect(&self, place: &Place) -> Option<Result<String, Wrong>> {
        self.motors.bus.inspect(place)
    }

    fn roles(&self) -> Vec<Role> {
        self.motors.roles()
    }

    fn serve(&self, place: &Place, mailbox: &Mailbox, reporter: &Reporter) -> Result<(), DeviceError> {
        run(&self.motors, session::Protocol::new(&self.motors), &self.heard(), place, mailbox, reporter)
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::new(self)
    }
}
