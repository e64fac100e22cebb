//! Measurements of one platform in one run, as time series.
//!
//! [`Recording`] is the one input of everything that explains data: comparison, diagnosis,
//! identification, calibration, estimation after the fact. [`read_run`] makes it of run directories and
//! bags, [`read_csv`] of CSV files, [`recording_of`] of arrays in memory, [`read_model`] reads what is known of the platform; nothing downstream
//! knows where a recording came from. [`write_run`] and [`export_csv`] are the ways back. What can be measured is the
//! table of [`Channel`]: all of these walk over it.

mod columns;
mod component;
mod consistency;
mod csv;
mod digits;
mod error;
mod finding;
mod memory;
mod model;
mod notes;
mod quality;
mod read;
mod recording;
mod refusal;
mod series;
mod still;
mod stretch;
mod supplies;
#[cfg(test)]
mod tests;
mod truth;
mod usable;
mod write;

pub use component::Component;
pub use consistency::SeenTurns;
pub use csv::{
    ExportedCsv, ImportedCsv, column_names, export_csv, platform_parts, read_csv, read_csv_beginning,
};
pub use digits::{Digits, digits_of_gyro};
pub use error::RecordingError;
pub use finding::Finding;
pub use memory::{Circumstances, JetPulses, Samples, recording_of};
pub use model::{KnownPlatform, load_effects, read_model, usual_rate_hz};
pub use read::{ReadOptions, nothing_in, read_run, read_run_with};
pub use recording::{Mounting, OnInterval, Recording, TrueMotion, VectorChannel};
pub use refusal::{Needs, Refusal, Why, check, counts};
pub use series::{ChannelSeries, Series};
pub use still::{Readings, Still, still_stretches};
pub use stretch::stretch;
pub use supplies::supplies;
pub use truth::TruthCheck;
pub use usable::usable_readings;
pub use whorl_bag::{Channel, ChannelInfo, Form};
pub use write::{RunOrigin, write_long_csv, write_run};
