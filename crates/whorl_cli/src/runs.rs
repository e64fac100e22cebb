//! Runs and the model that they are explained with: arguments that several commands share.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_bag::CsvMap;
use whorl_recording::{
    KnownPlatform, ReadOptions, Recording, platform_parts, read_csv, read_model, read_run_with,
};

/// Runs, and what they are read and judged with.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArguments {
    /// Run directories, rosbag2 directories, .mcap files, or CSV files with --channels.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    #[command(flatten)]
    pub context: RunContext,
}

/// What runs are read and judged with.
#[derive(Debug, Clone, clap::Args)]
pub struct RunContext {
    /// A run that takes part in no fit; may be given several times.
    #[arg(long, value_name = "RUN")]
    pub held_out: Vec<PathBuf>,
    /// The platform's parameter file [default: the parameters saved in the first run].
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// The platform, where runs or parameters hold several.
    #[arg(long, value_name = "NAME")]
    pub platform: Option<String>,
    /// Which topic or column holds what, for runs that are not Whorl's own.
    #[arg(long, value_name = "FILE")]
    pub channels: Option<PathBuf>,
}

/// What the arguments name, read.
#[derive(Debug)]
pub struct Runs {
    /// The platform.
    pub known: KnownPlatform,
    /// Runs that may be fitted.
    pub training: Vec<Recording>,
    /// Runs that may not.
    pub held_out: Vec<Recording>,
    /// For pages: what was compared.
    pub facts: Vec<(String, String)>,
}

impl RunArguments {
    /// Reads everything.
    pub fn read(&self) -> anyhow::Result<Runs> {
        let first = self.runs.first().context("no run was given")?;
        let source = self.context.model.as_deref().unwrap_or(first);
        // Its errors name the file.
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

/// Where answers go besides the terminal.
#[derive(Debug, Clone, clap::Args)]
pub struct OutputArguments {
    /// Writes all numbers as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Where the page goes [default: into the first run's directory, under the command's name].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl OutputArguments {
    /// Writes what `value` makes, if it was asked for.
    pub fn write_json<T: serde::Serialize>(
        &self,
        value: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<()> {
        let Some(path) = &self.json else { return Ok(()) };
        write(path, &serde_json::to_string_pretty(&value()?)?)
    }

    /// Writes the page: where `--html` says, else into the first run's directory, else beside its file. Says where.
    pub fn write_page(&self, runs: &RunArguments, name: &str, html: &str) -> anyhow::Result<PathBuf> {
        let first = runs.runs.first().map_or(Path::new(""), PathBuf::as_path);
        let beside = || if first.is_dir() { first.join(name) } else { first.with_file_name(name) };
        let path = self.html.clone().unwrap_or_else(beside);
        write(&path, html)?;
        Ok(path)
    }
}

impl Runs {
    /// Which of the runs have gaps, in sentences.
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

/// Writes a file whole.
pub fn write(path: &Path, content: &str) -> anyhow::Result<()> {
    std::fs::write(path, content).with_context(|| format!("cannot write {}", path.display()))
}
