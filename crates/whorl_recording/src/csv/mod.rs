//! Recordings from and to CSV.

mod columns;
mod export;
mod import;

pub use export::{ExportedCsv, column_names, export_csv};
pub use import::{ImportedCsv, platform_parts, read_csv};
