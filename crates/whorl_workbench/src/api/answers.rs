//! Answers, and samples.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A figure, as `plots.js` draws it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct FigureRow {
    /// The run that it is about; empty: all.
    pub run: String,
    /// Heading.
    pub title: String,
    /// One sentence on how to read it.
    pub caption: String,
    /// What a reader hears who does not see it.
    pub spoken: String,
    /// Curves, bands and axes.
    pub spec: Value,
}

/// A file before and after a change.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct FileChange {
    /// Path from the folder.
    pub file: String,
    /// Its text before; empty if there was none.
    pub before: String,
    /// Its text after.
    pub after: String,
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Answer {
    /// See [`Ask::name`].
    pub what: String,
    /// See [`AnswerRow::number`].
    pub number: u64,
    /// Most important first.
    pub sentences: Vec<String>,
    /// What the command's `--json` writes.
    pub json: Value,
    /// Its figures.
    pub figures: Vec<FigureRow>,
    /// Files that it has written.
    pub changes: Vec<FileChange>,
    /// The command that asks the same.
    pub command: String,
    /// How long it took \[s\].
    pub took_s: f64,
}

/// What was asked of the interface: an answer, by its name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AskAnswer {
    /// See [`Ask::name`].
    pub of: String,
    /// An earlier one; none: the one that holds, else the last.
    #[serde(default)]
    pub number: Option<u64>,
}

/// Samples of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AskSeries {
    /// Which recording.
    pub file: String,
    /// From this time on \[s\]; none: from the first sample.
    pub from_s: Option<f64>,
    /// To this time \[s\].
    pub to_s: Option<f64>,
    /// Most numbers of a signal.
    pub most: usize,
}

/// One signal in an answer of samples. Numbers follow the head: times as float64, values as float32, little-endian; a head is as long as
/// its first four bytes say, filled with blanks to a multiple of eight.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SignalRow {
    /// Its name: `gyro_x`.
    pub name: String,
    /// What shares a plot: `gyro`.
    pub group: String,
    /// Unit of the values.
    pub unit: String,
    /// Numbers.
    pub count: usize,
    /// Bytes behind the head at which its times begin.
    pub times_at: usize,
    /// The same of its values.
    pub values_at: usize,
    /// Holds until the next: a command.
    pub holds: bool,
    /// Standard deviation of the noise of a reading, in its unit; none where it cannot be told.
    pub noise: Option<f64>,
}

/// A stretch of a recording of which something is to be said.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Mark {
    /// `gap`, `held`, `left_out` (of fits) or `rest`.
    pub kind: String,
    /// The group of signals that it is about; empty: all.
    pub group: String,
    /// From \[s\].
    pub from_s: f64,
    /// To \[s\].
    pub to_s: f64,
}

/// Head of an answer of samples.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct SeriesHead {
    /// Which recording.
    pub file: String,
    /// Units and axes are known; else these are the columns of the file as they are.
    pub is_mapped: bool,
    /// First and last time of the recording \[s\].
    pub span_s: [f64; 2],
    /// Each stretch shows its smallest and its largest value.
    pub is_thinned: bool,
    /// The signals.
    pub signals: Vec<SignalRow>,
    /// What is to be said of stretches.
    pub marks: Vec<Mark>,
    /// What is to be said of the recording.
    pub remarks: Vec<String>,
}
