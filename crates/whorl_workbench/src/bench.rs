//! The state, in one place: what there is in the folder, what was chosen, asked and answered.

use std::collections::hash_map::DefaultHasher;
use std::collections::{BTreeSet, VecDeque};
use std::hash::{Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use axum::extract::ws::Utf8Bytes;
use tokio::sync::watch;
use whorl_commands::in_words;
use whorl_commands::runs::Runs;
use whorl_recording::{KnownPlatform, RecordingError};

use crate::api::{
    Answer, AnswerRow, Ask, Choice, EarlierRow, FigureRow, FileChange, FileKind, JobRow, LookedRow, ModelRow,
    Notice, SCHEMA, Stage, State,
};
use crate::columns::Columns;
use crate::done::{Done, Outcome};
use crate::project::{self, Seen, sources, sources_in};
use crate::stop::Stop;

/// Jobs that may wait.
const QUEUE: usize = 12;
/// Answers that are kept: those of a model before and after a step, and of the one before.
const ANSWERS: usize = 24;
/// Recordings whose samples are kept.
const LOOKED: usize = 12;
/// Messages that are kept.
const NOTICES: usize = 8;
/// Stages of a job that are listed.
const STAGES: usize = 40;
/// Smallest progress that is told.
const STEP: f64 = 0.005;

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
        inner.choice = project::completed(wanted, &inner.seen.files);
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

    /// Asks for something that takes a while; the same thing waits but once.
    pub(crate) fn ask(&self, ask: Ask) -> anyhow::Result<()> {
        let file = match &ask {
            Ask::Look { file } | Ask::Import { file, .. } => Some(file.clone()),
            _ => None,
        };
        if let Some(file) = file {
            self.listed(&file, FileKind::Recording)?;
        }
        self.change(|inner| {
            if inner.queue.len() >= QUEUE {
                bail!("{QUEUE} computations wait already: stop one first");
            }
            inner.push(ask);
            Ok(())
        })
    }

    /// Stops the job of this number; what waits stays.
    pub(crate) fn stop(&self, number: u64) {
        self.change(|inner| {
            if let Some(running) = inner.running.as_ref().filter(|running| running.number == number) {
                running.stop.now();
            }
        });
    }

    /// Forgets what waits.
    pub(crate) fn clear(&self) {
        self.change(|inner| inner.queue.clear());
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
            let mapped = (inner.choice.model != choice.model) || (inner.choice.channels != choice.channels);
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
            inner.choice = project::completed(inner.choice.clone(), &inner.seen.files);
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

    /// The next job; waits for one for so long.
    pub(crate) fn take(&self, patience: Duration) -> Option<(u64, Ask, Stop)> {
        let inner = self.inner();
        let (inner, _) = self
            .asked
            .wait_timeout_while(inner, patience, |inner| inner.queue.is_empty())
            .unwrap_or_else(PoisonError::into_inner);
        if inner.queue.is_empty() {
            return None;
        }
        drop(inner);
        self.change(|inner| {
            let ask = inner.queue.pop_front()?;
            inner.numbers += 1;
            let stop = Stop::default();
            inner.running = Some(Running {
                number: inner.numbers,
                ask: ask.clone(),
                began: Instant::now(),
                share: 0.0,
                stages: Vec::new(),
                stop: stop.clone(),
            });
            Some((inner.numbers, ask, stop))
        })
    }

    pub(crate) fn progress(&self, number: u64, share: f64, doing: &str) {
        let is_news = {
            let mut inner = self.inner();
            let Some(running) = inner.running.as_mut().filter(|running| running.number == number) else {
                return;
            };
            let is_new_stage = running.stages.last().is_none_or(|stage| stage.doing != doing);
            if is_new_stage && running.stages.len() < STAGES {
                let began_s = running.began.elapsed().as_secs_f64();
                running.stages.push(Stage { doing: doing.to_owned(), began_s });
            }
            // Work that begins anew is not undone.
            let moved = share > running.share + STEP;
            running.share = running.share.max(share.clamp(0.0, 1.0));
            is_new_stage || moved
        };
        if is_news {
            self.change(|_| ());
        }
    }

    pub(crate) fn ended(&self, number: u64, ask: &Ask, outcome: Outcome) {
        let seen = project::look(&self.folder);
        let remembered = self.change(|inner| {
            let took_s = inner.running.take().map_or(0.0, |running| running.began.elapsed().as_secs_f64());
            inner.seen = seen;
            let what = ask.name();
            if let Ask::Look { file } = ask
                && inner.arrived.remove(file)
                && matches!(outcome, Outcome::Done(_))
            {
                inner.join(file);
            }
            match outcome {
                Outcome::Stopped => inner.say("stopped", what, format!("{}: stopped.", ask.in_words())),
                Outcome::Failed(why) => {
                    inner.say("failed", what, why.replace(&format!("{}/", self.folder.display()), ""));
                }
                Outcome::Done(done) => {
                    if let Some(choice) = &done.choice {
                        inner.choice.clone_from(choice);
                    }
                    let again = done.again.clone();
                    if let Some(said) = &done.said {
                        inner.say("done", what, said.clone());
                    }
                    if done.is_answer {
                        let command = inner.command(ask);
                        let of = inner.asked_of();
                        let key = key(&self.folder, &inner.choice, with_exclusions(what));
                        inner.answers.push_back(Arc::new(Kept {
                            what,
                            number,
                            key,
                            done: *done,
                            command,
                            took_s,
                            of,
                        }));
                        let many = inner.answers.len().saturating_sub(ANSWERS);
                        inner.answers.drain(..many);
                    }
                    again.into_iter().for_each(|ask| inner.push(ask));
                }
            }
            inner.read_model(&self.folder);
            inner.choice.clone()
        });
        // A folder that cannot be written to is asked of again the next time.
        let _ = project::remember(&self.folder, &remembered);
    }
}

/// Whether an answer depends on what is left out.
fn with_exclusions(what: &str) -> bool {
    matches!(what, "diagnose" | "discover")
}

/// What an answer depends on: the choice, and what is in its files. Of recordings their size and date stand for it.
fn key(folder: &Path, choice: &Choice, with_exclusions: bool) -> u64 {
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
    fn push(&mut self, ask: Ask) {
        if self.queue.len() < QUEUE && !self.queue.contains(&ask) {
            self.queue.push_back(ask);
        }
    }

    /// A recording that has come, and was read, is used.
    fn join(&mut self, file: &str) {
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

    fn say(&mut self, kind: &str, what: &str, text: String) {
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

    /// Chosen runs that nobody has looked at yet are.
    fn look_at_runs(&mut self) {
        let runs = self.choice.runs.iter().chain(&self.choice.held_out);
        let new = runs.filter(|run| !self.looked.iter().any(|(row, _)| row.file == **run)).cloned();
        let new: Vec<String> = new.take(LOOKED).collect();
        new.into_iter().for_each(|file| self.push(Ask::Look { file }));
    }

    /// Reads what is to be said of the chosen model.
    fn read_model(&mut self, folder: &Path) {
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
                    self.platforms.clone_from(present);
                }
            }
        }
    }

    /// The answer that holds now, else the last; whether it is stale.
    fn current(&self, what: &str, keys: [u64; 2]) -> Option<(Arc<Kept>, bool)> {
        let now = keys[usize::from(with_exclusions(what))];
        let of = || self.answers.iter().rev().filter(|kept| kept.what == what);
        let (kept, is_stale) = match of().find(|kept| kept.key == now) {
            Some(kept) => (kept, false),
            None => (of().next()?, true),
        };
        Some((Arc::clone(kept), is_stale))
    }

    /// What answers depend on now: without and with what is left out.
    fn keys(&self, folder: &Path) -> [u64; 2] {
        [false, true].map(|with_exclusions| key(folder, &self.choice, with_exclusions))
    }

    /// Model and runs in words.
    fn asked_of(&self) -> String {
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
    fn command(&self, ask: &Ask) -> String {
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

    fn state(&self, folder: &Path) -> State {
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

/// A text file before and after; `None` where nothing has changed.
pub fn change_of(folder: &Path, file: &str, before: Option<String>) -> Option<FileChange> {
    let after = whorl_files::read_text(&folder.join(file)).ok()?;
    let before = before.unwrap_or_default();
    (before != after).then(|| FileChange { file: file.to_owned(), before, after })
}
