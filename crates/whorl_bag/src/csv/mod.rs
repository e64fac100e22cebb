//! CSV files: importing measurements, exporting recordings.

mod error;
mod export;
mod flatten;
mod import;
mod map;
mod reference;
mod table;

pub use error::CsvError;
pub use export::{ExportedTopic, export_csv};
pub use import::{CsvRecording, CsvSamples};
pub use map::{CsvMap, TruthMap, VectorMap};
