//! What wires and sockets have in common, whatever speaks over them.

mod can;
mod frame;
mod line;
mod serial;

pub use can::{Bus, Can};
pub use frame::{Frame, Record, Records};
pub use line::{Line, transmission};
pub use serial::Serial;
