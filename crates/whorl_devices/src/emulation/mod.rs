//! Devices that are not there: the same bytes on pseudo-terminals, sockets and files, at the same times, with a simulated
//! platform behind them.
//!
//! An [`Emulation`] is one platform. It finds ports, hosts and files in the same list of devices that the driver reads, and
//! offers them below a folder ([`crate::Place`]). Bytes take the time that they take on a line of the same rate. Faults of the
//! wire ([`Fault`]) and wrong wiring can be asked for.

use whorl_msgs::topics::{Message, MessageType};

mod faults;
mod ports;
mod server;
mod topics;
mod wire;
mod world;

pub use faults::{Fault, FaultKind, read};
pub use server::{Emulation, EmulationError, Setup};
pub use wire::Wire;
pub use world::World;

/// How a device is reached, and what it does there.
pub enum Emulator {
    /// On a serial port.
    Serial {
        /// As in the list of devices.
        port: String,
        /// Rate of the port [bit/s].
        baud: u32,
        /// The device.
        device: Box<dyn SerialEmulator>,
    },
    /// On the network.
    Tcp {
        /// As in the list of devices.
        host: String,
        /// The device.
        device: Box<dyn TcpEmulator>,
    },
    /// As files of the kernel.
    Files {
        /// As in the list of devices.
        folder: String,
        /// The device.
        device: Box<dyn FileEmulator>,
    },
    /// As a node of ROS 2.
    Topics {
        /// Topic that it reads, as in the list of devices.
        read: Option<(String, MessageType)>,
        /// Topic that it writes.
        write: Option<(String, MessageType)>,
        /// The device.
        device: Box<dyn TopicEmulator>,
    },
}

/// A device on a serial port. Times are nanoseconds of the world's clock.
pub trait SerialEmulator: Send {
    /// It was plugged in.
    fn switched_on(&mut self, now_ns: i64);

    /// A byte has come.
    fn byte(&mut self, at_ns: i64, byte: u8, world: &mut World, wire: &mut Wire);

    /// When it acts by itself.
    fn due_ns(&self) -> Option<i64>;

    /// It acts by itself, now or a little late.
    fn act(&mut self, now_ns: i64, world: &mut World, wire: &mut Wire);
}

/// A device with a TCP port, for one client.
pub trait TcpEmulator: Send {
    /// A client has come.
    fn connected(&mut self);

    /// Bytes have come.
    ///
    /// # Errors
    /// Why it closes the connection.
    fn bytes(
        &mut self,
        at_ns: i64,
        bytes: &[u8],
        world: &mut World,
        wire: &mut Wire,
    ) -> Result<(), &'static str>;

    /// When it acts by itself.
    fn due_ns(&self) -> Option<i64>;

    /// It acts by itself.
    fn act(&mut self, now_ns: i64, world: &mut World, wire: &mut Wire);
}

/// A device as a node of ROS 2. Times are nanoseconds of the world's clock.
pub trait TopicEmulator: Send {
    /// A message has come.
    fn message(&mut self, at_ns: i64, message: &Message, world: &mut World);

    /// When it acts by itself.
    fn due_ns(&self) -> Option<i64>;

    /// It acts by itself: what it sends, and since when.
    fn act(&mut self, now_ns: i64, world: &mut World) -> Option<(i64, Message)>;
}

/// A device as files.
pub trait FileEmulator: Send {
    /// When its files change.
    fn due_ns(&self) -> i64;

    /// Names and texts of its files now.
    fn act(&mut self, now_ns: i64, world: &mut World) -> Vec<(String, String)>;
}
