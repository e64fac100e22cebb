//! What changes of itself when something else does.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash as _, Hasher as _};
use std::path::Path;
use std::sync::Arc;

use whorl_commands::in_words;
use whorl_recording::RecordingError;

use super::{Inner, Kept, LOOKED, QUEUE};
use crate::api::{AnswerRow, Ask, Choice, EarlierRow, JobRow, ModelRow, Notice, SCHEMA, State};
use crate::project::{sources, sources_in};

/// Messages that are kept.
const NOTICES: usize = 8;
/// Whether an answer depends on what is left out.
pub(super) fn with_exclusions(what: &str) -> bool {
    matches!(what, "diagnose" | "discover")
}

/// What an answer depends on: the choice, and what is in its files. Of recordings their size and date stand for it.
pub(super) fn key(folder: &Path, choice: &Choice, with_exclusions: bool) -> u64 {
    let mut hash = DefaultHasher::new();
    (&choice.runs, &choice.held_out, &choice.model, &choice.channels, &choice.platform).hash(&mut hash);
    if with_exclusions {
        choice.exclude.hash(&mut hash);
    }
    for text in choice.model.iter().chain(&choice.channels) {
        whorl_files::read_text(&folder.join(text)).ok().hash(&mut hash);
    }
    for run in choice.runs.iter().chain(&choice.held_out) {
        let about = std::fs::metadata(folder.join(run)).ok();
        about.map(|about| (about.len(), about.modified().ok())).hash(&mut hash);
    }
    hash.finish()
}

impl Inner {
    pub(super) fn push(&mut self, ask: Ask) {
        if self.queue.len() < QUEUE && !self.queue.contains(&ask) {
            self.queue.push_back(ask);
        }
    }

    /// A recording that has come, and was read, is used.
    pub(super) fn join(&mut self, file: &str) {
        let is_mapped = self.looked.iter().any(|(row, columns)| row.file == file && columns.is_mapped());
        let runs = &mut self.choice.runs;
        if is_mapped {
            if !runs.iter().chain(&self.choice.held_out).any(|run| run == file) {
                runs.push(file.to_owned());
            }
            if self.answers.is_empty() {
                self.push(Ask::Compare);
            }
        } else if self.choice.model.is_none() || self.choice.channels.is_none() {
            *runs = vec![file.to_owned()];
            self.choice.held_out.clear();
            self.push(Ask::Import { file: file.to_owned(), rig: None });
        } else {
            let text = format!(
                "{file} is drawn as it is: the chosen platform and map do not read it. Choose others, or have them made."
            );
            self.say("stopped", "look", text);
        }
    }

    pub(super) fn say(&mut self, kind: &str, what: &str, text: String) {
        self.numbers += 1;
        self.notices.push_back(Notice {
            number: self.numbers,
            kind: kind.to_owned(),
            what: what.to_owned(),
            text,
        });
        let many = self.notices.len().saturating_sub(NOTICES);
        self.notices.drain(..many);
    }

    /// Chosen runs that nobody has looked at yet are, once it is known of which platform.
    pub(super) fn look_at_runs(&mut self) {
        if !self.platforms.is_empty() {
            return;
        }
        let runs = self.choice.runs.iter().chain(&self.choice.held_out);
        let new = runs.filter(|run| !self.looked.iter().any(|(row, _)| row.file == **run)).cloned();
        let new: Vec<String> = new.take(LOOKED).collect();
        new.into_iter().for_each(|file| self.push(Ask::Look { file }));
    }

    /// Reads what is to be said of the chosen model.
    pub(super) fn read_model(&mut self, folder: &Path) {
        (self.model, self.problem, self.platforms) = (None, None, Vec::new());
        if self.choice.runs.is_empty() {
            self.problem = Some(
                "No recording is chosen: drop a CSV file or a bag here, or choose one of the folder."
                    .to_owned(),
            );
            return;
        }
        let is_csv = self.choice.runs.iter().any(|run| run.ends_with(".csv") || run.ends_with(".csv.gz"));
        match sources_in(folder, &self.choice).read_model() {
            Ok(known) => {
                self.model = Some(ModelRow {
                    platform: known.platform.clone(),
                    effects: known.model.effects.keys().cloned().collect(),
                    steps: known.history.len(),
                });
                if is_csv && self.choice.channels.is_none() {
                    self.problem = Some(
                        "No map says what the columns of the CSV file are: choose one, or have one made."
                            .to_owned(),
                    );
                }
            }
            Err(_) if self.choice.model.is_none() && is_csv => {
                self.problem = Some(
                    "No platform's file is chosen: choose one, or have one made of the recording.".to_owned(),
                );
            }
            Err(error) => {
                self.problem = Some(in_words(&error).replace(&format!("{}/", folder.display()), ""));
                if let Some(RecordingError::SeveralModels { present, .. }) = error.downcast_ref() {
                    self.problem =
                        Some(format!("There are several platforms, {}: choose one.", present.join(" and ")));
                    self.platforms.clone_from(present);
                }
            }
        }
    }

    /// The answer that holds now, else the last; whether it is stale.
    pub(super) fn current(&self, what: &str, keys: [u64; 2]) -> Option<(Arc<Kept>, bool)> {
        let now = keys[usize::from(with_exclusions(what))];
        let of = || self.answers.iter().rev().filter(|kept| kept.what == what);
        let (kept, is_stale) = match of().find(|kept| kept.key == now) {
            Some(kept) => (kept, false),
            None => (of().next()?, true),
        };
        Some((Arc::clone(kept), is_stale))
    }

    /// What answers depend on now: without and with what is left out.
    pub(super) fn keys(&self, folder: &Path) -> [u64; 2] {
        [false, true].map(|with_exclusions| key(folder, &self.choice, with_exclusions))
    }

    /// Model and runs in words.
    pub(super) fn asked_of(&self) -> String {
        let effects = match &self.model {
            Some(model) if !model.effects.is_empty() => format!(" with {}", model.effects.join(", ")),
            _ => String::new(),
        };
        let file = self.choice.model.as_deref().unwrap_or("the run's own model");
        format!(
            "{file}{effects}: {}",
            self.choice.runs.iter().chain(&self.choice.held_out).cloned().collect::<Vec<_>>().join(", ")
        )
    }

    /// The command that does the same in the folder.
    pub(super) fn command(&self, ask: &Ask) -> String {
        let sources = sources(&self.choice);
        let exclusions =
            || self.choice.exclude.iter().flat_map(|id| ["--exclude", id.as_str()]).collect::<Vec<_>>();
        match ask {
            Ask::Look { file } => format!("whorl export {file}"),
            Ask::Import { file, .. } => format!("whorl new {}", whorl_math::words::shell_word(file)),
            Ask::Diagnose => sources.command("diagnose", &exclusions()),
            Ask::Discover => sources.command("discover", &exclusions()),
            Ask::Adopt { effects, .. } => {
                let effects = effects.iter().map(String::as_str);
                sources.command("adopt", &effects.chain(["--out", &sources.out()]).collect::<Vec<_>>())
            }
            other => sources.command(other.name(), &[]),
        }
    }

    pub(super) fn state(&self, folder: &Path) -> State {
        let keys = self.keys(folder);
        let answers =
            ["import", "compare", "where", "diagnose", "discover", "adopt"].iter().filter_map(|what| {
                let (kept, is_stale) = self.current(what, keys)?;
                Some(AnswerRow { what: (*what).to_owned(), number: kept.number, is_stale })
            });
        let asks = [Ask::Compare, Ask::Where, Ask::Diagnose, Ask::Discover];
        State {
            schema: SCHEMA,
            version: self.version,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            folder: folder.display().to_string(),
            files: self.seen.files.clone(),
            choice: self.choice.clone(),
            model: self.model.clone(),
            problem: self.problem.clone(),
            platforms: self.platforms.clone(),
            job: self.running.as_ref().map(|running| JobRow {
                number: running.number,
                what: running.ask.name().to_owned(),
                title: running.ask.in_words(),
                share: running.share,
                stages: running.stages.clone(),
                elapsed_s: running.began.elapsed().as_secs_f64(),
                stops: running.stop.is_told(),
            }),
            queue: self.queue.iter().map(Ask::in_words).collect(),
            answers: answers.collect(),
            earlier: self
                .answers
                .iter()
                .filter(|kept| kept.what == "compare")
                .map(|kept| EarlierRow {
                    what: kept.what.to_owned(),
                    number: kept.number,
                    of: kept.of.clone(),
                })
                .collect(),
            looked: self.looked.iter().map(|(row, _)| row.clone()).collect(),
            notices: self.notices.iter().cloned().collect(),
            commands: asks.iter().map(|ask| (ask.name().to_owned(), self.command(ask))).collect(),
        }
    }
}
