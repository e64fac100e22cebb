//! Runs and their model, read from files.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_bag::CsvMap;
use whorl_explain::Case;
use whorl_math::words::shell_word;
use whorl_objects::{is_remote, local};
use whorl_recording::{
    KnownPlatform, ReadOptions, Recording, RecordingError, platform_parts, read_csv, read_model,
    read_run_with, usable_readings,
};

/// Where runs and their model are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunSources {
    /// Training runs: run directories, rosbag2 directories, `.mcap` files, or CSV files with `channels`.
    pub runs: Vec<PathBuf>,
    /// Held-out runs: used to test, never to fit.
    pub held_out: Vec<PathBuf>,
    /// The platform's parameter file; `None`: the parameters saved in the first run.
    pub model: Option<PathBuf>,
    /// Name of the platform, where runs or parameters hold several.
    pub platform: Option<String>,
    /// Map of topics or columns, for runs that Whorl did not record.
    pub channels: Option<PathBuf>,
}

/// The runs and the model, read from their files.
#[derive(Debug)]
pub struct Runs {
    /// The platform.
    pub known: KnownPlatform,
    /// Training runs: used to fit.
    pub training: Vec<Recording>,
    /// Held-out runs: never used to fit.
    pub held_out: Vec<Recording>,
    /// Facts for the pages: platform, model, runs.
    pub facts: Vec<(String, String)>,
}

impl RunSources {
    /// The model: of its file, else that saved in the first run.
    ///
    /// # Errors
    /// What is wrong with it, and what would help.
    pub fn read_model(&self) -> anyhow::Result<KnownPlatform> {
        match (&self.model, self.runs.first()) {
            (None, Some(first)) if is_remote(first) => {
                self.on_copies(std::slice::from_ref(first), |runs| Self { runs, ..self.clone() }.model_here())
            }
            _ => self.model_here(),
        }
    }

    fn model_here(&self) -> anyhow::Result<KnownPlatform> {
        let first = self.runs.first().context("no run was given")?;
        let source = self.model.as_deref().unwrap_or(first);
        // Errors of the reader name the file.
        match read_model(source, self.platform.as_deref()) {
            Err(_) if self.model.is_none() && is_csv(first) => {
                bail!(
                    "{}: a CSV file holds no parameters: name the platform's file, e.g. --model params/whorl_1.yaml; for a rig of \
                     your own {} writes one, and the map of its columns",
                    first.display(),
                    of_new(first)
                )
            }
            read => Ok(read?),
        }
    }

    /// A command about these runs, to be copied: `whorl where 'my run' --held-out b --model m.yaml`; `further` are its other words.
    #[must_use]
    pub fn command(&self, name: &str, further: &[&str]) -> String {
        let path = |path: &PathBuf| shell_word(&path.display().to_string());
        let mut words = vec!["whorl".to_owned(), name.to_owned()];
        words.extend(self.runs.iter().map(path));
        words.extend(further.iter().map(|word| shell_word(word)));
        words.extend(self.held_out.iter().flat_map(|run| ["--held-out".to_owned(), path(run)]));
        for (option, file) in [("--model", &self.model), ("--channels", &self.channels)] {
            words.extend(file.iter().flat_map(|file| [option.to_owned(), path(file)]));
        }
        words.extend(self.platform.iter().flat_map(|name| ["--platform".to_owned(), shell_word(name)]));
        words.join(" ")
    }

    /// Where a command is to write a changed model: the model's file; a run keeps the parameters with which it was made.
    #[must_use]
    pub fn out(&self) -> String {
        self.model.as_ref().map_or_else(|| "better.yaml".to_owned(), |model| model.display().to_string())
    }

    /// The same for each platform whose model there is, where none was chosen.
    ///
    /// # Errors
    /// As [`Self::read_model`].
    pub fn of_each_platform(&self) -> anyhow::Result<Vec<Self>> {
        let of = |platform: String| Self { platform: Some(platform), ..self.clone() };
        match self.read_model() {
            Ok(_) => Ok(vec![self.clone()]),
            Err(error) => match error.downcast::<RecordingError>()? {
                RecordingError::SeveralModels { present, .. } => Ok(present.into_iter().map(of).collect()),
                other => Err(other.into()),
            },
        }
    }

    /// Reads everything.
    ///
    /// # Errors
    /// What is wrong with runs or model, and what would help.
    pub fn read(&self) -> anyhow::Result<Runs> {
        let all: Vec<PathBuf> = self.runs.iter().chain(&self.held_out).cloned().collect();
        if !all.iter().any(|path| is_remote(path)) {
            return self.read_here();
        }
        let first = self.runs.first().map(|path| path.display().to_string());
        self.on_copies(&all, |mut runs| {
            let held_out = runs.split_off(self.runs.len().min(runs.len()));
            let mut read = Self { runs, held_out, ..self.clone() }.read_here()?;
            // Not the copy.
            let source = read.facts.iter_mut().find(|(key, _)| key == "model" && self.model.is_none());
            if let (Some((_, source)), Some(first)) = (source, first) {
                *source = first;
            }
            Ok(read)
        })
    }

    /// What is read of copies on this machine, whose names stand in no error.
    fn on_copies<T>(
        &self,
        paths: &[PathBuf],
        read: impl FnOnce(Vec<PathBuf>) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let copies = paths.iter().map(|path| local(path)).collect::<Result<Vec<_>, _>>()?;
        read(copies.iter().map(|copy| copy.path().to_owned()).collect()).map_err(|error| {
            anyhow::Error::msg(copies.iter().fold(crate::in_words(&error), |text, copy| copy.told(&text)))
        })
    }

    fn read_here(&self) -> anyhow::Result<Runs> {
        let mut known = self.read_model()?;
        let read = |paths: &[PathBuf]| -> anyhow::Result<Vec<Recording>> {
            paths.iter().map(|path| self.recording(path, &known)).collect()
        };
        let (training, held_out) = (read(&self.runs)?, read(&self.held_out)?);
        if let Some(first) = training.first() {
            known.take_rates_of(first);
        }
        let first = self.runs.first().map(PathBuf::as_path);
        let source = self.model.as_deref().or(first).unwrap_or(Path::new(""));
        Ok(Runs::new(known, training, held_out, &source.display().to_string()))
    }

    /// One of the runs.
    ///
    /// # Errors
    /// What is wrong with it, and what would help.
    pub fn recording(&self, path: &Path, known: &KnownPlatform) -> anyhow::Result<Recording> {
        let options = ReadOptions {
            platform: Some(&known.platform),
            model: Some(&known.model),
            channels: self.channels.as_deref(),
        };
        let mut recordings = match (is_csv(path), &self.channels) {
            (true, None) => bail!(
                "{}: a CSV file needs a map of its columns, --channels MAP.yaml: {} writes one (docs/recordings.md)",
                path.display(),
                of_new(path)
            ),
            (true, Some(map)) => {
                let map = CsvMap::load_for(map, &platform_parts(known))?;
                let recording = read_csv(path, &map, known)?.recording;
                recording.check_fits(&known.model, &known.platform)?;
                vec![recording]
            }
            _ => read_run_with(path, &options)?,
        };
        match recordings.len() {
            1 => {
                let recording = recordings.remove(0);
                refuse_contradictions(&recording, known, &path.display().to_string())?;
                Ok(recording)
            }
            0 => bail!("{} holds no measurements of {}", path.display(), known.platform),
            _ => bail!("{} holds several platforms: choose one with --platform", path.display()),
        }
    }
}

/// Refuses a recording whose channels contradict themselves or each other.
///
/// # Errors
/// The first contradiction, in a sentence. `name` is what the recording is called in it.
pub fn refuse_contradictions(recording: &Recording, known: &KnownPlatform, name: &str) -> anyhow::Result<()> {
    match recording.contradictions(Some(&known.model)).first() {
        Some(reason) => bail!("{name} cannot be explained: {reason}"),
        None => Ok(()),
    }
}

impl Runs {
    /// Runs that have been read; `source` says where the model is from.
    #[must_use]
    pub fn new(
        known: KnownPlatform,
        training: Vec<Recording>,
        held_out: Vec<Recording>,
        source: &str,
    ) -> Self {
        let list = |recordings: &[Recording]| {
            recordings
                .iter()
                .map(|r| format!("{} ({:.1} s)", r.name, r.duration_s()))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let mut facts = vec![
            ("platform".to_owned(), known.platform.clone()),
            ("model".to_owned(), source.to_owned()),
            ("effects of the model".to_owned(), effects_of(&known)),
            ("runs".to_owned(), list(&training)),
        ];
        if !held_out.is_empty() {
            facts.push(("held-out runs".to_owned(), list(&held_out)));
        }
        facts.push(("Whorl version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()));
        Self { known, training, held_out, facts }
    }

    /// The case to explain.
    #[must_use]
    pub fn case(&self) -> Case<'_> {
        Case {
            training: &self.training,
            held_out: &self.held_out,
            model: &self.known.model,
            prior: &self.known.prior,
        }
    }

    /// Sentences about readings that fits leave out.
    #[must_use]
    pub fn left_out(&self) -> Vec<String> {
        let runs = self.training.iter().chain(&self.held_out);
        runs.flat_map(|run| usable_readings(run, &self.known.model).1).collect()
    }

    /// Sentences about gaps in the runs.
    pub fn gaps(&self) -> impl Iterator<Item = String> {
        self.training.iter().chain(&self.held_out).filter_map(Recording::gaps)
    }
}

/// The command that makes a model and a map of a file, to be copied.
#[must_use]
pub fn of_new(file: &Path) -> String {
    format!("`whorl new {}`", shell_word(&file.display().to_string()))
}

/// A CSV file, plain or compressed.
#[must_use]
pub fn is_csv(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    !path.is_dir() && (name.ends_with(".csv") || name.ends_with(".csv.gz"))
}

fn effects_of(known: &KnownPlatform) -> String {
    let ids: Vec<&str> = known.model.effects.keys().map(String::as_str).collect();
    if ids.is_empty() { "none".to_owned() } else { ids.join(", ") }
}

/// Writes a file.
///
/// # Errors
/// When it cannot be written.
pub fn write(path: &Path, content: &str) -> anyhow::Result<()> {
    whorl_files::write_file(path, content).with_context(|| format!("cannot write {}", path.display()))
}
