//! Runs and their model: arguments that several commands share.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_bag::CsvMap;
use whorl_recording::{
    KnownPlatform, ReadOptions, Recording, platform_parts, read_csv, read_model, read_run_with,
};

/// Runs, with the options for reading and testing them.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArguments {
    /// Run directories, rosbag2 directories, .mcap files, or CSV files with --channels.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    #[command(flatten)]
    pub context: RunContext,
}

/// Options for reading and testing runs.
#[derive(Debug, Clone, clap::Args)]
pub struct RunContext {
    /// Held-out run: used to test, never to fit; may be given several times.
    #[arg(long, value_name = "RUN")]
    pub held_out: Vec<PathBuf>,
    /// The platform's parameter file [default: the parameters saved in the first run].
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Name of the platform, where runs or parameters hold several.
    #[arg(long, value_name = "NAME")]
    pub platform: Option<String>,
    /// Map of topics or columns, for runs that Whorl did not record.
    #[arg(long, value_name = "FILE")]
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

impl RunArguments {
    /// Reads everything.
    pub fn read(&self) -> anyhow::Result<Runs> {
        let first = self.runs.first().context("no run was given")?;
        let source = self.context.model.as_deref().unwrap_or(first);
        // Errors of the reader name the file.
        let known = match read_model(source, self.context.platform.as_deref()) {
            Err(_) if self.context.model.is_none() && is_csv(first) => {
                bail!(
                    "{}: a CSV file holds no parameters: name the platform's file, e.g. --model params/whorl_1.yaml",
                    first.display()
                )
            }
            read => read?,
        };
        let read = |paths: &[PathBuf]| -> anyhow::Result<Vec<Recording>> {
            paths.iter().map(|path| self.recording(path, &known)).collect()
        };
        let (training, held_out) = (read(&self.runs)?, read(&self.context.held_out)?);
        let list = |recordings: &[Recording]| {
            recordings
                .iter()
                .map(|r| format!("{} ({:.1} s)", r.name, r.duration_s()))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let mut facts = vec![
            ("platform".to_owned(), known.platform.clone()),
            ("model".to_owned(), source.display().to_string()),
            ("effects of the model".to_owned(), effects_of(&known)),
            ("runs".to_owned(), list(&training)),
        ];
        if !held_out.is_empty() {
            facts.push(("held-out runs".to_owned(), list(&held_out)));
        }
        facts.push(("Whorl version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()));
        Ok(Runs { known, training, held_out, facts })
    }

    fn recording(&self, path: &Path, known: &KnownPlatform) -> anyhow::Result<Recording> {
        let options = ReadOptions {
            platform: Some(&known.platform),
            model: Some(&known.model),
            channels: self.context.channels.as_deref(),
        };
        let mut recordings = match (is_csv(path), &self.context.channels) {
            (true, None) => bail!(
                "{}: a CSV file needs a map of its columns, --channels MAP.yaml: docs/recordings.md shows one",
                path.display()
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
                if let Some(reason) = recording.contradictions(Some(&known.model)).first() {
                    bail!("{} cannot be explained: {reason}", path.display());
                }
                Ok(recording)
            }
            0 => bail!("{} holds no measurements of {}", path.display(), known.platform),
            _ => bail!("{} holds several platforms: choose one with --platform", path.display()),
        }
    }
}

/// Output files for the answer.
#[derive(Debug, Clone, clap::Args)]
pub struct OutputArguments {
    /// Writes all numbers as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Path of the HTML page [default: the first run's directory, named after the command].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl OutputArguments {
    /// Writes the JSON that `value` returns, if requested.
    pub fn write_json<T: serde::Serialize>(
        &self,
        value: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        write(path, &serde_json::to_string_pretty(&value()?)?)
    }

    /// Writes the page to `--html`, else into the first run's directory, else beside its file. Returns the path.
    pub fn write_page(&self, runs: &RunArguments, name: &str, html: &str) -> anyhow::Result<PathBuf> {
        let first = runs.runs.first().map_or(Path::new(""), PathBuf::as_path);
        let beside = || if first.is_dir() { first.join(name) } else { first.with_file_name(name) };
        let path = self.html.clone().unwrap_or_else(beside);
        write(&path, html)?;
        Ok(path)
    }
}

impl Runs {
    /// Sentences about gaps in the runs.
    pub fn gaps(&self) -> impl Iterator<Item = String> {
        self.training.iter().chain(&self.held_out).filter_map(Recording::gaps)
    }
}

/// A CSV file, plain or compressed.
fn is_csv(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    !path.is_dir() && (name.ends_with(".csv") || name.ends_with(".csv.gz"))
}

fn effects_of(known: &KnownPlatform) -> String {
    let ids: Vec<&str> = known.model.effects.keys().map(String::as_str).collect();
    if ids.is_empty() { "none".to_owned() } else { ids.join(", ") }
}

/// Writes a file.
pub fn write(path: &Path, content: &str) -> anyhow::Result<()> {
    std::fs::write(path, content).with_context(|| format!("cannot write {}", path.display()))
}
