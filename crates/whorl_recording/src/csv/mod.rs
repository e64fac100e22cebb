//! Recordings from and to CSV.

mod export;
mod import;

pub use export::{ExportedCsv, column_names, export_csv};
pub(crate) use import::lines_again;
pub use import::{ImportedCsv, platform_parts, read_csv, read_csv_beginning};
