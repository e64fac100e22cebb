//! Recordings made ready for fits: evenly averaged, cut at gaps, checked.

mod averaging;
mod checks;
mod surroundings;
mod wheels;

pub(crate) use averaging::{CONTACT_LASTS_S, touches};
pub use averaging::{Chain, Direction, Point, PreparedData, prepare};
pub use checks::{DataError, Finding};
pub use surroundings::Surroundings;
