//! CSV files: importing measurements, exporting recordings.

mod error;
mod export;
mod flatten;
mod import;
mod jets;
mod map;
mod reference;
mod rows;
mod table;

pub use error::CsvError;
pub use export::{ExportedTopic, export_csv};
pub use import::{CsvRecording, CsvSamples};
pub use jets::{CsvPulse, JetCommand, JetMap, JetQuantity, Slot};
pub use map::{ColumnMap, CsvMap, NO_COLUMN, PlatformParts, TimeMap, TruthMap, VectorMap};
pub use rows::{CsvRow, CsvRows};
