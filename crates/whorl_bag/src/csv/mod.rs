//! CSV files: importing measurements, exporting recordings.

mod angle;
mod clock;
mod error;
mod export;
mod flatten;
mod foreign;
pub mod held;
mod import;
mod iso;
mod jets;
mod look;
mod map;
mod reference;
mod rows;
mod same_time;
mod sequence;
mod source;
mod table;
mod time;

pub use angle::AngleMap;
pub use error::CsvError;
pub use export::{ExportedTopic, export_csv};
pub use import::{CsvRecording, CsvSamples};
pub use jets::{CsvPulse, JetCommand, JetMap, JetQuantity, Slot};
pub use look::{CsvLook, LookedColumn, look};
pub use map::{ColumnMap, CsvMap, PlatformParts, TruthMap, VectorMap};
pub use rows::CsvRow;
pub use sequence::CsvRows;
pub use table::NO_COLUMN;
pub use time::{Duplicates, TimeMap, TimeSource};
