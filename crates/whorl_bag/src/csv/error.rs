//! Why a CSV file could not be used.

use std::path::{Path, PathBuf};

use thiserror::Error;
use whorl_math::words::{or_did_you_mean, shortened};
use whorl_params::ParameterErrors;

/// Characters of a cell that are shown.
pub(super) const LONGEST: usize = 60;
/// Characters of the names of all columns that are shown.
const LONGEST_HEADER: usize = 2000;

/// Errors of CSV files. They name file, line (from 1, the header is line 1) and column.
#[derive(Debug, Error)]
pub enum CsvError {
    /// The file that says which column is which is wrong.
    #[error(transparent)]
    Map(#[from] ParameterErrors),
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// A file of another program.
    #[error("{}: this is {what}, no CSV file: {then}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// What makes CSV of it.
        then: String,
    },
    /// Not CSV: unequal numbers of cells, wrong UTF-8, or a damaged compressed file.
    #[error("{}:{line}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// What is wrong.
        reason: String,
    },
    /// A column that the map names is not in the file.
    #[error(
        "{}:1: there is no column `{column}`; there are: {}{}", path.display(),
        if present.is_empty() { "none".into() } else { shortened(present, LONGEST_HEADER) },
        or_did_you_mean(column, present.split(", "))
    )]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// The columns of the file.
        present: String,
    },
    /// A cell that is not a number.
    #[error(
        "{}:{line}: column `{column}`: {} is not a number{hint}", path.display(),
        if text.is_empty() { "an empty cell".to_owned() } else { format!("`{}`", shortened(text, LONGEST)) }
    )]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// The column.
        column: String,
        /// The cell.
        text: String,
        /// What may help.
        hint: &'static str,
    },
    /// A number that its quantity cannot have.
    #[error("{}:{line}: column `{column}`: {} is refused; {allowed}", path.display(), shortened(text, LONGEST))]
    Refused {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// The column.
        column: String,
        /// The cell.
        text: String,
        /// What is allowed.
        allowed: String,
    },
    /// The time does not increase.
    #[error(
        "{}:{line}: column `{column}`: time {time_s} s does not come after {previous_s} s{}", path.display(),
        if time_s == previous_s {
            "; where several lines have one time, `duplicates` of the map's time says which counts: first, mean, or burst: \
             measured one after the other since the time before"
        } else {
            ""
        }
    )]
    TimeOrder {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// The time column.
        column: String,
        /// Time in this line \[s\].
        time_s: f64,
        /// Time in the line before \[s\].
        previous_s: f64,
    },
    /// No line with a measurement.
    #[error("{}: there are no measurements: no line of numbers", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// No second in which the reference direction of the vector sensor could be determined.
    #[error(
        "{}: no second has specific force and vector measurements to determine the vector sensor's reference \
         direction from: give it as vector.reference_world",
        path.display()
    )]
    NoReference {
        /// The file.
        path: PathBuf,
    },
    /// A recording to be exported cannot be read.
    #[error(transparent)]
    Bag(#[from] crate::BagError),
}

impl CsvError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// `line` is where reading stood when the parser gave up.
    pub(crate) fn format(path: &Path, line: u64, error: &::csv::Error) -> Self {
        let line = error.position().map_or(line, ::csv::Position::line);
        Self::Format { path: path.to_owned(), line, reason: reason(error) }
    }
}

fn reason(error: &::csv::Error) -> String {
    match error.kind() {
        ::csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells, but the header has {expected_len}")
        }
        ::csv::ErrorKind::Utf8 { err, .. } => format!("cell {}: not UTF-8", err.field() + 1),
        ::csv::ErrorKind::Io(error) => error.to_string(),
        _ => error.to_string(),
    }
}
