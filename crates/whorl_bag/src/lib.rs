//! Recordings: rosbag2 MCAP, CSV, and the run directory with its manifest.
//!
//! The only crate that knows MCAP.
//!
//! - [`BagWriter`] and [`BagReader`]: rosbag2 directories (`metadata.yaml` and MCAP), readable up to the last
//!   half second after the writer was killed; [`recover`] makes such a bag complete.
//! - [`RunWriter`] and [`RunDirectory`]: `<UTC time>_<experiment>/` with `bag/`, `params/`, `manifest.yaml`
//!   and `summary.json`.
//! - [`Channel`]: the table of what can be measured of a platform, one row each: key, unit, axes, topic and field.
//! - [`CsvMap`], [`CsvRows`]: CSV files of any form, line by line in SI units;
//!   [`CsvRecording`], [`measurements()`]: what a platform's hardware would have sent, for replay;
//!   [`export_csv`]: a recording for spreadsheets.
//! - [`SequenceTracker`], [`TopicStatistics`]: losses, gaps and rates, without files or clocks.

mod background;
mod channels;
mod compression;
mod csv;
mod error;
pub mod extra;
mod layout;
mod manifest;
mod measurements;
mod metadata;
mod qos;
mod reader;
mod recover;
mod run_directory;
mod run_writer;
mod scan;
mod sequence;
mod statistics;
mod storage;
mod summary;
mod units;
mod unpacked;
mod utc;
mod writer;
mod yaml;

pub use background::BackgroundRunWriter;
pub use channels::{AXES, Carrier, Channel, ChannelInfo, Form, Place, blank};
pub use csv::{
    AngleMap, ColumnMap, CsvError, CsvLook, CsvMap, CsvPulse, CsvRecording, CsvRow, CsvRows, CsvSamples,
    Duplicates, ExportedTopic, JetCommand, JetMap, JetQuantity, LookedColumn, NO_COLUMN, PlatformParts, Slot,
    TimeMap, TimeSource, TruthMap, VectorMap, export_csv, held, look,
};
pub use error::BagError;
pub use layout::{BAG_DIRECTORY, PARAMETER_DIRECTORY, SUMMARY_FILE};
pub use manifest::{MANIFEST_FILE, Manifest, ParameterFile, RunDescription, RunState};
pub use measurements::{Measurement, measurements, stamp_of};
pub use metadata::{BagFile, BagMetadata, BagTopic, METADATA_FILE};
pub use qos::offered_qos_profiles;
pub use reader::{BagReader, MessageFilter, Messages, RecordedMessage};
pub use recover::{Recovery, recover};
pub use run_directory::{RunDirectory, recover_runs};
pub use run_writer::{RawSample, RunTopicHandle, RunWriter, new_run_directory};
pub use scan::Integrity;
pub use sequence::{Arrival, SequenceCounts, SequenceTracker};
pub use statistics::{GAP_PERIODS, TopicStatistics, TopicSummary, WriterId};
pub use units::Unit;
pub use unpacked::is_bag;
pub use utc::utc;
pub use writer::{BagOptions, BagWriter, Compression, Sample, TopicHandle};

#[cfg(test)]
mod tests;
