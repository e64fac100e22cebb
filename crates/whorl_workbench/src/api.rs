//! What the page and the program say to each other. The schema of these types is `api.schema.json`; Python checks against it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Version of the interface.
pub const SCHEMA: u32 = 1;

/// What a file of the folder is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FileKind {
    /// A CSV file, a bag, a run directory.
    Recording,
    /// Parameters of a platform.
    Model,
    /// A map of columns or topics.
    Map,
}

/// A file of the folder.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, JsonSchema)]
pub struct FileRow {
    /// Path from the folder, with `/`.
    pub path: String,
    /// What it is.
    pub kind: FileKind,
    /// Its size; of a folder that of what is right in it.
    pub bytes: u64,
}

/// What was chosen of the folder: the arguments of a command.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Choice {
    /// Training runs: used to fit.
    pub runs: Vec<String>,
    /// Held-out runs: used to test, never to fit.
    pub held_out: Vec<String>,
    /// The platform's parameter file; none: the parameters saved in the first run.
    pub model: Option<String>,
    /// Map of columns or topics, for runs that Whorl did not record.
    pub channels: Option<String>,
    /// Name of the platform, where there are several.
    pub platform: Option<String>,
    /// Effects that a diagnosis leaves out, by their ids.
    pub exclude: Vec<String>,
}

/// Something that takes a while.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Ask {
    /// The samples of a recording.
    Look {
        /// Which.
        file: String,
    },
    /// Model and map of a recording that comes with neither.
    Import {
        /// Which.
        file: String,
        /// Kind of rig (table, hinge, wheel_bench, free); none: what the file looks like.
        rig: Option<String>,
    },
    /// How far off is the model?
    Compare,
    /// Where does it fail?
    Where,
    /// Which effect is missing?
    Diagnose,
    /// Which law, where no effect of the catalogue explains the data?
    Discover,
    /// Adds effects to the model's file.
    Adopt {
        /// Their ids.
        effects: Vec<String>,
        /// Writes even against an objection.
        anyway: bool,
    },
}

impl Ask {
    /// The name of its answer.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Look { .. } => "look",
            Self::Import { .. } => "import",
            Self::Compare => "compare",
            Self::Where => "where",
            Self::Diagnose => "diagnose",
            Self::Discover => "discover",
            Self::Adopt { .. } => "adopt",
        }
    }

    /// In words, for a list of what is being done.
    #[must_use]
    pub fn in_words(&self) -> String {
        match self {
            Self::Look { file } => format!("Reading {file}"),
            Self::Import { file, .. } => format!("Finding out what is what in {file}"),
            Self::Compare => "Comparing model and measurements".to_owned(),
            Self::Where => "Finding where the model fails".to_owned(),
            Self::Diagnose => "Diagnosing".to_owned(),
            Self::Discover => "Searching for a law".to_owned(),
            Self::Adopt { effects, .. } => format!("Adopting {}", effects.join(" and ")),
        }
    }
}

/// A step of a job.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Stage {
    /// What was done.
    pub doing: String,
    /// Since the job began \[s\].
    pub began_s: f64,
}

/// The job that runs.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct JobRow {
    /// Counts up.
    pub number: u64,
    /// See [`Ask::name`].
    pub what: String,
    /// In words.
    pub title: String,
    /// 0 to 1.
    pub share: f64,
    /// What was and is being done, in order.
    pub stages: Vec<Stage>,
    /// Since it began \[s\].
    pub elapsed_s: f64,
    /// It was told to stop, and ends with its current step.
    pub stops: bool,
}

/// An answer that there is.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AnswerRow {
    /// See [`Ask::name`].
    pub what: String,
    /// Counts up with each answer.
    pub number: u64,
    /// Files or choice have changed since.
    pub is_stale: bool,
}

/// A recording that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct LookedRow {
    /// Its path.
    pub file: String,
    /// Another one when it was read again.
    pub number: u64,
}

/// An answer that was given before, of these files or others: to be laid over another.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct EarlierRow {
    /// See [`Ask::name`].
    pub what: String,
    /// See [`AnswerRow::number`].
    pub number: u64,
    /// The model and the runs that it was asked of, in words.
    pub of: String,
}

/// A message for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Notice {
    /// Counts up.
    pub number: u64,
    /// `done`, `stopped` or `failed`.
    pub kind: String,
    /// See [`Ask::name`].
    pub what: String,
    /// In words.
    pub text: String,
}

/// The chosen model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct ModelRow {
    /// Name of the platform.
    pub platform: String,
    /// Effects of the model, by their ids.
    pub effects: Vec<String>,
    /// Steps of its history.
    pub steps: usize,
}

/// Everything but numbers: what all pages see.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct State {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Counts up with each change.
    pub version: u64,
    /// Version of the program.
    pub program: String,
    /// The folder.
    pub folder: String,
    /// Its files.
    pub files: Vec<FileRow>,
    /// What was chosen of them.
    pub choice: Choice,
    /// The chosen model, if it can be read.
    pub model: Option<ModelRow>,
    /// Why it cannot be read, or what is to be chosen first.
    pub problem: Option<String>,
    /// Platforms, where a choice is to be made between them.
    pub platforms: Vec<String>,
    /// The job that runs.
    pub job: Option<JobRow>,
    /// What waits, in words.
    pub queue: Vec<String>,
    /// Answers that there are.
    pub answers: Vec<AnswerRow>,
    /// Comparisons that were made before.
    pub earlier: Vec<EarlierRow>,
    /// Recordings whose samples can be drawn.
    pub looked: Vec<LookedRow>,
    /// The last messages, oldest first.
    pub notices: Vec<Notice>,
    /// The commands that ask the same of the same files, by the names of the answers.
    pub commands: Vec<(String, String)>,
}

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
    /// `gap`, `held`, `clipped` or `rest`.
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

/// A text file of the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TextFile {
    /// Path from the folder.
    pub file: String,
    /// Its text; when asked for: empty.
    #[serde(default)]
    pub text: String,
}

/// A number of the model.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ParameterRow {
    /// Key in the file, below the platform's section.
    pub key: String,
    /// Its value as the file has it.
    pub value: String,
    /// Standard deviations of its prior, as the file has them; none: what is typical.
    pub stddev: Option<String>,
    /// Where the prior is from.
    pub source: Option<String>,
    /// Where the value stands: file and line.
    pub origin: String,
}

/// An arrow of the drawing, body axes.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Arrow {
    /// What it is: `wheel`, `jet`, `gimbal`.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Where \[m\]; none: it may be anywhere.
    pub at_m: Option<[f64; 3]>,
    /// Direction: spin axis, force.
    pub direction: [f64; 3],
}

/// The platform as its file has it.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Platform {
    /// Its name.
    pub platform: String,
    /// How it may move: on_bearing, hinge, free, clamped.
    pub freedom: String,
    /// Axis of a hinge, body axes.
    pub hinge_axis: Option<[f64; 3]>,
    /// Torque of gravity at full tilt, body axes [N m]: weight times the offset of the centre of mass.
    pub gravity_offset_n_m: [f64; 3],
    /// Principal moments of inertia [kg m^2] ...
    pub principal_moments_kg_m2: [f64; 3],
    /// ... and the axes that they are about, body axes.
    pub principal_axes: [[f64; 3]; 3],
    /// Wheels and jets.
    pub arrows: Vec<Arrow>,
    /// Every number of the model's file.
    pub parameters: Vec<ParameterRow>,
    /// What was adopted when: as `whorl history --json`.
    pub history: Value,
}

/// A value to write into the model's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SetParameter {
    /// Key below the platform's section: `model.mass_kg`, `model_prior.inertia_kg_m2.zz`.
    pub key: String,
    /// As it is to stand in the file.
    pub value: String,
}

/// A channel in the map of a CSV file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct MapRow {
    /// Its key.
    pub key: String,
    /// Columns in the order of its axes, wheels or jets; `-` before one reverses its sign, `~` stands for none.
    pub columns: Vec<String>,
    /// Their unit; none: SI.
    pub unit: Option<String>,
    /// The units that it may have.
    pub units: Vec<String>,
}

/// The map of a CSV file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct ChannelMap {
    /// Its file.
    pub file: String,
    /// Its channels.
    pub rows: Vec<MapRow>,
    /// Columns of the recording.
    pub columns: Vec<String>,
}

/// Columns and unit to write into the map.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SetChannel {
    /// The channel's key.
    pub key: String,
    /// See [`MapRow::columns`].
    pub columns: Vec<String>,
    /// See [`MapRow::unit`]; none: as it is.
    pub unit: Option<String>,
}

/// A stretch of a recording, to be one of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stretch {
    /// Which recording.
    pub file: String,
    /// From \[s\].
    pub from_s: f64,
    /// To \[s\].
    pub to_s: f64,
    /// It tests, and is never fitted.
    pub held_out: bool,
}

/// An effect of the catalogue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct EffectRow {
    /// Its id.
    pub id: String,
    /// A few words.
    pub title: String,
    /// The mechanism, and how it shows.
    pub explanation: String,
    /// Its equation, in plain text.
    pub equation: String,
    /// Where that is from.
    pub source: String,
    /// What separates it from those that it is confused with.
    pub separated_by: String,
}

/// Everything that is said, for the schema.
#[derive(Debug, JsonSchema)]
#[expect(dead_code, reason = "its schema is used, not its value")]
pub struct Interface {
    state: State,
    ask: Ask,
    answer: Answer,
    ask_answer: AskAnswer,
    ask_series: AskSeries,
    series: SeriesHead,
    text: TextFile,
    platform: Platform,
    set: SetParameter,
    stretch: Stretch,
    map: ChannelMap,
    set_channel: SetChannel,
    effects: Vec<EffectRow>,
}

/// The schema of all of it (JSON Schema 2020-12).
#[must_use]
pub fn schema() -> Value {
    schemars::schema_for!(Interface).to_value()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The schema beside the sources is that of the types: for who reads it without this program. It is written anew where it is not.
    #[test]
    fn the_schema_is_that_of_the_types() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("api.schema.json");
        let text = serde_json::to_string_pretty(&schema()).unwrap() + "\n";
        let there = std::fs::read_to_string(&path).unwrap_or_default();
        if there != text {
            std::fs::write(&path, &text).unwrap();
            panic!("{} was not current and is written anew: commit it", path.display());
        }
    }

    #[test]
    fn what_pages_ask_is_read() {
        let ask = |text: &str| serde_json::from_str::<Ask>(text);
        assert_eq!(ask(r#"{"what": "compare"}"#).unwrap(), Ask::Compare);
        let adopt = Ask::Adopt { effects: vec!["a".to_owned()], anyway: false };
        assert_eq!(ask(r#"{"what": "adopt", "effects": ["a"], "anyway": false}"#).unwrap(), adopt);
        assert!(ask(r#"{"what": "format_disk"}"#).is_err());
        assert_eq!(serde_json::from_str::<Choice>("{}").unwrap(), Choice::default());
    }
}
