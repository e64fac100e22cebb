//! What comes of a job.

use serde_json::Value;
use whorl_report::Drawn;

use crate::api::{Ask, Choice, FileChange};

/// What a job has done.
#[derive(Debug, Clone, Default)]
pub struct Done {
    /// It has an answer, which is kept.
    pub is_answer: bool,
    /// Most important first.
    pub sentences: Vec<String>,
    /// What the command's `--json` writes.
    pub json: Value,
    pub figures: Vec<Drawn>,
    /// Files that it has written.
    pub changes: Vec<FileChange>,
    /// What is chosen from now on.
    pub choice: Option<Choice>,
    /// What is to be asked again.
    pub again: Vec<Ask>,
    /// A message.
    pub said: Option<String>,
}

/// How a job ended.
pub enum Outcome {
    /// It has an answer.
    Done(Box<Done>),
    /// It was told to stop.
    Stopped,
    /// Why there is none.
    Failed(String),
}
