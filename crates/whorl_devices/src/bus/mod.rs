//! What wires and sockets have in common, whatever speaks over them.

mod line;
mod serial;

pub use line::{Line, transmission};
pub use serial::Serial;
