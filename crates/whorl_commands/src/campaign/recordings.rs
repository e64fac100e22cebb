//! Campaigns over recordings: one question to each, its answer as JSON in the task's row.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::{Value, json};
use whorl_bag::RunDirectory;
use whorl_campaign::recordings::{Item, Question, RecordingsDefinition};
use whorl_campaign::work::{Folder, Tasks};
use whorl_dynamics::effects::{Effect as _, catalogue, registered};
use whorl_objects::{Local, ObjectError};
use whorl_params::effect_files_beside;
use whorl_recording::load_effects;

use super::Tables;
use super::answers::{self, Asked};

/// Version of the rows.
const SCHEMA: u32 = 1;
/// Recordings without an answer that are told one by one.
const MOST_TOLD: usize = 5;

/// A campaign over recordings.
#[derive(Debug, Clone)]
pub struct RecordingPlan {
    definition: RecordingsDefinition,
    /// Folder of the campaign's file.
    base: PathBuf,
    items: Vec<Item>,
    /// Written effects that belong to it: of its file, of its model, and of its recordings.
    own_effects: BTreeSet<String>,
}

impl RecordingPlan {
    /// The campaign of a file in `base`; its effects become part of the catalogue.
    ///
    /// # Errors
    /// Files that are not there, effects that cannot be loaded or that do not exist.
    pub fn new(definition: RecordingsDefinition, base: &Path) -> anyhow::Result<Self> {
        let mut plan =
            Self { definition, base: base.to_owned(), items: Vec::new(), own_effects: BTreeSet::new() };
        for (_, file) in plan.files() {
            anyhow::ensure!(file.is_file(), "no file {}", file.display());
        }
        for file in &plan.definition.effects {
            let effect = whorl_params::load_effect(&base.join(file))?;
            plan.own_effects.insert(effect.info().id.to_owned());
        }
        if let Some(model) = plan.model() {
            load_effects(&model)?;
            plan.own(&[model]);
        }
        Ok(plan)
    }

    /// Takes the effects beside these parameter files for its own.
    fn own(&mut self, files: &[PathBuf]) {
        // The name of an effect's file is its id.
        let stem = |file: PathBuf| file.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        self.own_effects.extend(effect_files_beside(files).into_iter().filter_map(stem));
    }

    /// Effects that are not considered: those that the file excludes, and those that somebody else has added to the catalogue
    /// of this process.
    pub(super) fn excluded(&self) -> Vec<String> {
        let foreign = registered().into_iter().map(|effect| effect.info().id);
        let foreign = foreign.filter(|id| !self.own_effects.contains(*id)).map(str::to_owned);
        self.definition.exclude.iter().cloned().chain(foreign).collect()
    }

    /// The files that it names, beside its recordings.
    fn files(&self) -> Vec<(&'static str, PathBuf)> {
        let of = &self.definition;
        let one = |key, file: &Option<String>| file.as_ref().map(|file| (key, self.base.join(file)));
        let effects = of.effects.iter().map(|file| ("effects", self.base.join(file)));
        one("model_file", &of.model).into_iter().chain(one("channels", &of.channels)).chain(effects).collect()
    }

    /// What is asked.
    #[must_use]
    pub fn definition(&self) -> &RecordingsDefinition {
        &self.definition
    }

    /// The parameter file, where one is named.
    pub(super) fn model(&self) -> Option<PathBuf> {
        self.definition.model.as_ref().map(|file| self.base.join(file))
    }

    /// The map of topics or columns, where one is named.
    pub(super) fn channels(&self) -> Option<PathBuf> {
        self.definition.channels.as_ref().map(|file| self.base.join(file))
    }

    /// Path of a recording.
    pub(super) fn path(&self, item: &Item) -> PathBuf {
        whorl_objects::join(&self.base, &item.recording)
    }

    /// What decides the answers beside the recordings: version, catalogue, question, files.
    pub(super) fn fingerprint(&self) -> anyhow::Result<String> {
        let mut text = format!("whorl {}\n", env!("CARGO_PKG_VERSION"));
        let written: Vec<&str> = registered().iter().map(|effect| effect.info().id).collect();
        let built_in = catalogue().iter().map(|effect| effect.info().id).filter(|id| !written.contains(id));
        let ids: Vec<&str> = built_in.collect();
        text.push_str(&format!("effects: {}\n", ids.join(", ")));
        for (key, file) in self.files() {
            let content =
                whorl_files::read_text(&file).with_context(|| format!("cannot read {}", file.display()))?;
            text.push_str(&format!("# {key}\n{content}\n"));
        }
        text.push_str(&format!("{:#?}\n", self.definition));
        Ok(text)
    }

    /// Learns the recordings from the folder, and from the disk who holds it.
    pub(super) fn list(&mut self, folder: &Folder, grow: bool) -> anyhow::Result<()> {
        let of = &self.definition;
        self.items = if grow { of.extended(&self.base, folder) } else { of.listed(&self.base, folder) }?;
        self.unknown_effects_excluded()?;
        // Effects that come with a recording are candidates for all, whoever computes what in which order.
        let with_effects = self.items.iter().filter(|item| item.has_effects);
        for path in with_effects.map(|item| self.path(item)).collect::<BTreeSet<_>>() {
            // Its own task says what is wrong with them.
            let Ok(here) = whorl_objects::local(&path) else { continue };
            let _ = load_effects(here.path());
            if let Ok(run) = RunDirectory::open(here.path()) {
                self.own(&run.parameter_files());
            }
        }
        Ok(())
    }

    fn unknown_effects_excluded(&self) -> anyhow::Result<()> {
        let known = |id: &&String| whorl_dynamics::effects::find(id).is_none();
        match self.definition.exclude.iter().find(known) {
            Some(unknown) => {
                anyhow::bail!("exclude: there is no effect {unknown}; `whorl effects` lists them")
            }
            None => Ok(()),
        }
    }

    /// Every recording that matches now, in a line.
    pub(super) fn lines(&self) -> anyhow::Result<Vec<String>> {
        let found = self.definition.found(&self.base)?;
        let line = |(index, item): (usize, &Item)| {
            format!("{index:6}  {}  {}", item.recording, item.platform.as_deref().unwrap_or(""))
        };
        Ok(found.iter().enumerate().map(line).collect())
    }

    /// Every task as data.
    pub(super) fn as_json(&self) -> anyhow::Result<Vec<Value>> {
        let item = |item: &Item| json!({"recording": item.recording, "platform": item.platform});
        Ok(self.definition.found(&self.base)?.iter().map(item).collect())
    }

    /// The row of a recording.
    fn row(&self, folder: &Folder, item: &Item) -> io::Result<Value> {
        let path = self.path(item);
        // A server that does not answer is no fault of the recording: the task has no row then.
        let here = match whorl_objects::local(&path) {
            // What has gone since is as a file that has gone.
            Err(ObjectError::Nothing(_)) => Local::as_given(&path),
            found => found?,
        };
        let run = RunDirectory::open(here.path()).ok();
        let manifest = run.as_ref().and_then(RunDirectory::manifest);
        let began = manifest.map(|manifest| manifest.start_utc.0 as f64 * 1e-9);
        let asked = Asked {
            definition: &self.definition,
            model: self.model(),
            channels: self.channels(),
            excluded: self.excluded(),
        };
        let (outcome, reason, answer) = match answers::answer(&asked, folder, item, here.path()) {
            Ok(answer) => ("done", String::new(), answer),
            Err(error) => match error.downcast::<answers::Unwritten>() {
                Ok(error) => return Err(io::Error::other(error)),
                Err(error) => {
                    ("failed", here.told(&crate::in_words(&error)).replace(['\n', '\r'], " "), Value::Null)
                }
            },
        };
        Ok(json!({
            "schema": SCHEMA,
            "task": self.definition.question.name(),
            "recording": item.recording,
            "run": path.file_stem().unwrap_or_default().to_string_lossy(),
            "platform": answer.get("platform").and_then(Value::as_str).or(item.platform.as_deref()).unwrap_or_default(),
            "experiment": manifest.map(|manifest| manifest.description.experiment.clone()).unwrap_or_default(),
            "began_unix_s": began,
            "outcome": outcome,
            "reason": reason,
            "answer": answer,
        }))
    }

    /// Writes the tables of what is done.
    pub(super) fn write_tables(&self, folder: &Folder) -> anyhow::Result<Tables> {
        let rows: Vec<(u64, Value)> =
            folder.rows(self.len(), |index, text| serde_json::from_str(text).map(|row| (index, row)))?;
        let table = answers::table(self.definition.question, &rows);
        let csv = folder.path().join("summary.csv");
        whorl_files::write_file(&csv, table.csv_text()?)
            .with_context(|| format!("cannot write {}", csv.display()))?;
        let parquet = folder.path().join("table");
        table.write(&parquet.join("rows.parquet"))?;
        let further = answers::further(self.definition.question, &rows, folder)?;
        Ok(Tables { csv, parquet, further, page: None, rows: rows.len(), said: self.said(&rows) })
    }

    /// What came of the recordings.
    fn said(&self, rows: &[(u64, Value)]) -> Vec<String> {
        let text =
            |row: &Value, key: &str| row.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
        let mut said = Vec::new();
        if self.definition.question == Question::Diagnose {
            let mut verdicts: BTreeMap<String, usize> = BTreeMap::new();
            for (_, row) in rows.iter().filter(|(_, row)| text(row, "outcome") == "done") {
                *verdicts.entry(answers::verdict(row)).or_default() += 1;
            }
            let mut verdicts: Vec<_> = verdicts.into_iter().collect();
            verdicts.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
            said.extend(verdicts.into_iter().map(|(verdict, count)| format!("{count} x {verdict}")));
        }
        let failed: Vec<_> = rows.iter().filter(|(_, row)| text(row, "outcome") != "done").collect();
        said.extend(failed.iter().take(MOST_TOLD).map(|(_, row)| {
            let platform = text(row, "platform");
            let of = if platform.is_empty() { String::new() } else { format!(" ({platform})") };
            format!("{}{of}: {}", text(row, "recording"), text(row, "reason"))
        }));
        if failed.len() > MOST_TOLD {
            said.push(format!("and {} more without an answer", failed.len() - MOST_TOLD));
        }
        said
    }
}

impl Tasks for RecordingPlan {
    fn len(&self) -> u64 {
        self.items.len() as u64
    }

    fn ending(&self) -> &'static str {
        "json"
    }

    /// Asks the question of a recording.
    fn compute(&self, folder: &Folder, index: u64) -> io::Result<String> {
        let item = usize::try_from(index).ok().and_then(|index| self.items.get(index));
        let item = item.ok_or_else(|| io::Error::other(format!("there is no recording {index}")))?;
        Ok(self.row(folder, item)?.to_string())
    }
}
