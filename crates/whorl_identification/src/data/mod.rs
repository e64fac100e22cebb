//! Recordings made ready for fits: evenly averaged, cut at gaps, checked.

mod averaging;
mod checks;
mod wheels;

pub use averaging::{Chain, Direction, Point, PreparedData, prepare};
pub use checks::{DataError, Finding};
