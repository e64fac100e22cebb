//! The state, in one place: what there is in the folder, what was chosen, asked and answered.

mod inner;
mod queue;

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Context as _, bail};
use axum::extract::ws::Utf8Bytes;
use tokio::sync::watch;
use whorl_commands::runs::Runs;
use whorl_prediction::Stop;
use whorl_recording::KnownPlatform;

use self::inner::key;
use crate::api::{
    Answer, Ask, Choice, FigureRow, FileChange, FileKind, LookedRow, ModelRow, Notice, Stage, State,
};
use crate::columns::Columns;
use crate::done::Done;
use crate::project::{self, Seen, sources_in};

/// Jobs that may wait.
const QUEUE: usize = 12;
/// Recordings whose samples are kept.
const LOOKED: usize = 12;

/// A folder that is open.
#[derive(Debug)]
pub struct Workbench {
    folder: PathBuf,
    inner: Mutex<Inner>,
    asked: Condvar,
    latest: watch::Sender<Utf8Bytes>,
}

/// An answer, kept with what it was asked of.
#[derive(Debug)]
pub struct Kept {
    pub what: &'static str,
    pub number: u64,
    /// Of choice and files, see [`key`].
    key: u64,
    pub done: Done,
    pub command: String,
    pub took_s: f64,
    /// Model and runs in words.
    of: String,
}

#[derive(Debug)]
struct Running {
    number: u64,
    ask: Ask,
    began: Instant,
    share: f64,
    stages: Vec<Stage>,
    stop: Stop,
}

#[derive(Debug, Default)]
struct Inner {
    version: u64,
    seen: Seen,
    choice: Choice,
    model: Option<ModelRow>,
    problem: Option<String>,
    platforms: Vec<String>,
    runs: Option<(u64, Arc<Runs>)>,
    numbers: u64,
    queue: VecDeque<Ask>,
    running: Option<Running>,
    answers: VecDeque<Arc<Kept>>,
    looked: VecDeque<(LookedRow, Arc<Columns>)>,
    /// Recordings that came and were not read yet.
    arrived: BTreeSet<String>,
    notices: VecDeque<Notice>,
}

impl Workbench {
    /// A folder of which these files are chosen; nothing is done yet.
    ///
    /// # Errors
    /// When the folder cannot be read, or a file is not in it.
    pub(crate) fn new(folder: &Path, files: &[PathBuf]) -> anyhow::Result<Arc<Self>> {
        let folder = folder.canonicalize().with_context(|| format!("cannot open {}", folder.display()))?;
        std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
        let mut inner = Inner { seen: project::look(&folder), ..Inner::default() };
        let mut wanted = project::remembered(&folder);
        if !files.is_empty() {
            wanted = Choice::default();
        }
        for file in files {
            let path = file.canonicalize().with_context(|| format!("cannot open {}", file.display()))?;
            let inside = path.strip_prefix(&folder).ok().and_then(Path::to_str).map(str::to_owned);
            let row = inside.and_then(|path| inner.seen.files.iter().find(|row| row.path == path));
            let Some(row) = row else {
                bail!("{}: no recording, platform file or map in {}", file.display(), folder.display());
            };
            match row.kind {
                FileKind::Recording => wanted.runs.push(row.path.clone()),
                FileKind::Model => wanted.model = Some(row.path.clone()),
                FileKind::Map => wanted.channels = Some(row.path.clone()),
            }
        }
        inner.choice = project::completed(wanted, &folder, &inner.seen.files);
        let (latest, _) = watch::channel(Utf8Bytes::default());
        let bench = Arc::new(Self { folder, inner: Mutex::new(inner), asked: Condvar::new(), latest });
        bench.change(|inner| {
            inner.read_model(&bench.folder);
            inner.look_at_runs();
            if inner.problem.is_none() && !inner.choice.runs.is_empty() {
                inner.push(Ask::Compare);
            }
        });
        Ok(bench)
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Each new state.
    pub(crate) fn states(&self) -> watch::Receiver<Utf8Bytes> {
        self.latest.subscribe()
    }

    pub(crate) fn state(&self) -> State {
        let inner = self.inner();
        inner.state(&self.folder)
    }

    pub(crate) fn choice(&self) -> Choice {
        self.inner().choice.clone()
    }

    /// Whether the folder has this file.
    pub(crate) fn listed(&self, file: &str, kind: FileKind) -> anyhow::Result<PathBuf> {
        let inner = self.inner();
        if inner.seen.files.iter().any(|row| row.path == file && row.kind == kind) {
            return Ok(self.folder.join(file));
        }
        bail!("{file:?} is not among the files of this folder")
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and tells all pages.
    fn change<T>(&self, change: impl FnOnce(&mut Inner) -> T) -> T {
        let mut inner = self.inner();
        let result = change(&mut inner);
        inner.version += 1;
        let state = inner.state(&self.folder);
        drop(inner);
        self.latest.send_replace(serde_json::to_string(&state).unwrap_or_default().into());
        self.asked.notify_all();
        result
    }

    /// Chooses files, a platform and effects to leave out.
    pub(crate) fn choose(&self, choice: Choice) -> anyhow::Result<()> {
        self.change(|inner| {
            let is_new =
                |list: &[String]| list.iter().any(|run| !inner.seen.files.iter().any(|f| f.path == *run));
            if is_new(&choice.runs) || is_new(&choice.held_out) {
                bail!("a run that was chosen is not in the folder");
            }
            if let Some(both) = choice.runs.iter().find(|run| choice.held_out.contains(run)) {
                bail!("{both} cannot be both for training and held out");
            }
            let of =
                |choice: &Choice| (choice.model.clone(), choice.channels.clone(), choice.platform.clone());
            let mapped = of(&inner.choice) != of(&choice);
            inner.choice = choice;
            if mapped {
                inner.looked.clear();
            }
            inner.read_model(&self.folder);
            inner.look_at_runs();
            Ok(())
        })?;
        project::remember(&self.folder, &self.choice())
    }

    /// A file has come into the folder: it is looked at, and what is missing to explain it is made. Whether it is of any use here.
    pub(crate) fn arrived(&self, file: &str) -> bool {
        let seen = project::look(&self.folder);
        self.change(|inner| {
            inner.seen = seen;
            let kind = inner.seen.files.iter().find(|row| row.path == file).map(|row| row.kind);
            inner.looked.retain(|(other, _)| other.file != file);
            match kind {
                Some(FileKind::Recording) => {
                    inner.arrived.insert(file.to_owned());
                    inner.push(Ask::Look { file: file.to_owned() });
                }
                Some(FileKind::Model) => inner.choice.model = Some(file.to_owned()),
                Some(FileKind::Map) => inner.choice.channels = Some(file.to_owned()),
                None => {}
            }
            inner.read_model(&self.folder);
            kind.is_some()
        })
    }

    /// The chosen runs and their model, read once for each state of their files.
    pub(crate) fn runs(&self) -> anyhow::Result<Arc<Runs>> {
        let choice = self.choice();
        let key = key(&self.folder, &choice, false);
        if let Some((of, runs)) = &self.inner().runs
            && *of == key
        {
            return Ok(Arc::clone(runs));
        }
        let runs = Arc::new(sources_in(&self.folder, &choice).read()?);
        self.inner().runs = Some((key, Arc::clone(&runs)));
        Ok(runs)
    }

    /// The chosen model.
    pub(crate) fn known(&self) -> anyhow::Result<KnownPlatform> {
        let mut sources = sources_in(&self.folder, &self.choice());
        // A model that is named needs no run to be fitted to.
        sources.runs.append(&mut sources.held_out);
        sources.read_model()
    }

    /// Samples of a recording, if it was looked at.
    pub(crate) fn columns(&self, file: &str) -> Option<Arc<Columns>> {
        self.inner().looked.iter().find(|(row, _)| row.file == file).map(|(_, columns)| Arc::clone(columns))
    }

    pub(crate) fn looked(&self, file: &str, columns: Columns) {
        self.change(|inner| {
            inner.looked.retain(|(row, _)| row.file != file);
            inner.numbers += 1;
            let row = LookedRow { file: file.to_owned(), number: inner.numbers };
            inner.looked.push_back((row, Arc::new(columns)));
            let many = inner.looked.len().saturating_sub(LOOKED);
            inner.looked.drain(..many);
        });
    }

    /// The answer that holds now, else the last one; `None` if there is none.
    pub(crate) fn kept(&self, what: &str) -> Option<Arc<Kept>> {
        let inner = self.inner();
        inner.current(what, inner.keys(&self.folder)).map(|(kept, _)| kept)
    }

    /// The answer for a page.
    pub(crate) fn answer(&self, what: &str, number: Option<u64>) -> Option<Answer> {
        let kept = match number {
            None => self.kept(what)?,
            Some(number) => Arc::clone(self.inner().answers.iter().find(|kept| kept.number == number)?),
        };
        let figures = kept.done.figures.iter().enumerate().map(|(k, drawn)| FigureRow {
            run: drawn.run.clone(),
            title: drawn.title().to_owned(),
            caption: drawn.caption().to_owned(),
            spoken: drawn.spoken(),
            spec: drawn.stored(&format!("{}_{}", kept.what, k + 1)),
        });
        Some(Answer {
            what: kept.what.to_owned(),
            number: kept.number,
            sentences: kept.done.sentences.clone(),
            json: kept.done.json.clone(),
            figures: figures.collect(),
            changes: kept.done.changes.clone(),
            command: kept.command.clone(),
            took_s: kept.took_s,
        })
    }

    /// Looks whether files have changed by other hands.
    pub(crate) fn look(&self) {
        let seen = project::look(&self.folder);
        if seen == self.inner().seen {
            return;
        }
        self.change(|inner| {
            inner.seen = seen;
            inner.choice = project::completed(inner.choice.clone(), &self.folder, &inner.seen.files);
            inner.read_model(&self.folder);
        });
    }

    /// Something was done at once: a message, and a look at what has changed.
    pub(crate) fn did(&self, what: &str, text: String) {
        let seen = project::look(&self.folder);
        self.change(|inner| {
            inner.seen = seen;
            inner.say("done", what, text);
            inner.read_model(&self.folder);
            // What columns are may have changed.
            if what == "write" {
                inner.looked.clear();
                inner.look_at_runs();
            }
        });
    }

    /// Whether nothing may write to the model's file now.
    pub(crate) fn is_writing(&self) -> bool {
        let inner = self.inner();
        let running = inner.running.as_ref().map(|running| running.ask.name());
        matches!(running, Some("adopt" | "import"))
    }
}

/// A text file before and after; `None` where nothing has changed.
pub fn change_of(folder: &Path, file: &str, before: Option<String>) -> Option<FileChange> {
    let after = whorl_files::read_text(&folder.join(file)).ok()?;
    let before = before.unwrap_or_default();
    (before != after).then(|| FileChange { file: file.to_owned(), before, after })
}
