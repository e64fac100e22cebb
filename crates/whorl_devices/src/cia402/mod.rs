//! Motor controllers of the CANopen profile CiA 402, as maxon's EPOS4, with reaction wheels on their motors.
//!
//! Every cycle is a message to each controller with controlword and torque or speed, one SYNC that has all of them act and
//! measure at the same instant, and from each controller its statusword, speed and torque. Controllers are set up at every
//! connection, and nothing permanent is written. They watch the driver's heartbeat and switch off without it.

mod emulator;
pub mod protocol;
mod session;
#[cfg(test)]
mod tests;

use whorl_dynamics::PlatformModel;
use whorl_params::{Reader, positive};

use crate::DeviceError;
use crate::can_motors::{CanMotors, Traits, run};
use crate::device::{Address, Device, DeviceKind, Role, Wrong};
use crate::emulation::Emulator;
use crate::mailbox::Mailbox;
use crate::place::Place;
use crate::reading::Reporter;
use protocol::{DRIVER, SYNC, Service, identifier};

/// Its row in the table.
pub const KIND: DeviceKind = DeviceKind {
    name: "cia402_motors",
    what: "CANopen motor controllers of profile CiA 402, such as maxon EPOS4, on a CAN bus: reaction wheels",
    read,
};

/// Largest torque that can be asked for, in thousandths of the rated one.
const LARGEST_TORQUE: f64 = 32_767.0;

const TRAITS: Traits = Traits {
    nodes: 1..=126,
    // Controlword and target; SYNC and the driver's heartbeat; statusword, speed and torque.
    cycle: &[6, 1, 8],
    watchdog: "controllers switch off so long after the driver's last heartbeat [s]; 0: they do not watch it",
    shortest_watchdog_s: 0.05,
};

/// Controllers of one bus.
#[derive(Debug, Clone)]
struct Controllers {
    motors: CanMotors,
    rated_torque_n_m: f64,
}

fn read(r: &mut Reader<'_>, model: &PlatformModel) -> Option<Box<dyn Device>> {
    let before = r.error_count();
    let doc = "torque of the motors at their nominal current [N m], as object 0x6076 has it";
    let rated_torque_n_m = r.f64("rated_torque_n_m", positive(), doc);
    let motors = CanMotors::read(r, model, &TRAITS)?;
    let largest = motors.motors.iter().map(|motor| motor.max_torque_n_m).fold(0.0, f64::max);
    if largest / rated_torque_n_m * 1000.0 > LARGEST_TORQUE && r.error_count() == before {
        let problem = format!(
            "the wheels' {largest} N m are more than can be asked for; allowed: at least {:.3e} N m",
            largest * 1000.0 / LARGEST_TORQUE
        );
        r.reject("rated_torque_n_m", problem);
    }
    (r.error_count() == before).then(|| Box::new(Controllers { motors, rated_torque_n_m }) as Box<dyn Device>)
}

impl Controllers {
    /// What controllers send.
    fn heard(&self) -> Vec<u16> {
        let services = [Service::Emergency, Service::TransmitPdo, Service::SdoAnswer, Service::Heartbeat];
        let nodes = self.motors.motors.iter().map(|motor| motor.node);
        nodes.flat_map(|node| services.map(|service| identifier(service, node))).collect()
    }

    /// What the driver sends. Commands to a bus's communication belong to all of its nodes, as SYNC does.
    fn said(&self) -> Vec<u16> {
        let services = [Service::ReceivePdo, Service::SdoQuestion];
        let nodes = self.motors.motors.iter().map(|motor| motor.node);
        let to_nodes = nodes.flat_map(|node| services.map(|service| identifier(service, node)));
        [protocol::NMT, SYNC, identifier(Service::Heartbeat, DRIVER)].into_iter().chain(to_nodes).collect()
    }
}

impl Device for Controllers {
    fn addresses(&self) -> Vec<Address> {
        self.motors.bus.addresses(self.said().into_iter().chain(self.heard()))
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
        run(&self.motors, session::Protocol::new(self), &self.heard(), place, mailbox, reporter)
    }

    fn emulator(&self, _: &PlatformModel) -> Emulator {
        emulator::new(self)
    }
}
