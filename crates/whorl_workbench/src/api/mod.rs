//! What the page and the program say to each other. The schema of these types is `api.schema.json`; `python/tests/test_workbench.py` holds what is said to it.

mod answers;
mod files;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub use answers::{Answer, AskAnswer, AskSeries, FigureRow, FileChange, Mark, SeriesHead, SignalRow};
pub use files::{
    Arrow, ChannelMap, EffectRow, MapRow, ParameterRow, Platform, SetChannel, SetParameter, Stretch, TextFile,
};

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
    /// It was told to stop.
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
