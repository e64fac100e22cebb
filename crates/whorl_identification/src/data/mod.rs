//! Recordings made ready for fits: evenly averaged, cut at gaps, checked.

mod averaging;
mod checks;
mod surroundings;
mod wheels;

pub use averaging::{AveragedSample, Chain, Direction, PreparedData, prepare};
pub(crate) use averaging::{CONTACT_LASTS_S, touches};
pub use checks::{DataError, Finding};
pub use surroundings::Surroundings;
