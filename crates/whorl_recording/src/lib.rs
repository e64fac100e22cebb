//! What was measured of one platform in one run, as series over time.
//!
//! [`Recording`] is the one input of everything that explains data: comparison, diagnosis,
//! identification, calibration, estimation after the fact. Run directories, bags and CSV files are
//! read into it; nothing downstream knows where a recording came from.

mod recording;
mod series;

pub use recording::{Mounting, OnInterval, Recording, TrueMotion, VectorChannel};
pub use series::Series;
