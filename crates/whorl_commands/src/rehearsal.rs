//! Simulation of manoeuvres before they are proposed.

use std::fs::DirBuilder;
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::Context;
use whorl_dynamics::PlatformModel;
use whorl_params::Value;
use whorl_params::changes::changes;
use whorl_recording::{KnownPlatform, ReadOptions, Recording, read_run_with};

use crate::simulate;

/// How many stages this process has made.
static STAGES: AtomicU64 = AtomicU64::new(0);

/// A parameter folder in which the simulated platform is the fitted one, and control has the model as given.
/// Removed at the end.
pub struct Stage {
    folder: PathBuf,
    platform: String,
}

impl Drop for Stage {
    fn drop(&mut self) {
        // Only files that this command has created.
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Stage {
    /// `own` is the text of the platform's parameter file, `common` the file that all nodes share.
    pub fn new(
        known: &KnownPlatform,
        own: &str,
        common: &Path,
        truth: &PlatformModel,
    ) -> anyhow::Result<Self> {
        // Several diagnoses of one process may rehearse at the same time.
        let folder = new_folder()?;
        let stage = Self { folder: folder.clone(), platform: known.platform.clone() };
        for part in ["truth", "experiments"] {
            let path = folder.join(part);
            std::fs::create_dir_all(&path).with_context(|| format!("cannot create {}", path.display()))?;
        }
        std::fs::copy(common, folder.join("common.yaml"))
            .with_context(|| format!("cannot read {}", common.display()))?;
        let copy = folder.join(format!("{}.yaml", known.platform));
        whorl_files::write_file(&copy, own).with_context(|| format!("cannot write {}", copy.display()))?;
        let mut text = format!(
            "/{}/driver:\n  ros__parameters:\n    truth:\n      simulated_for_design.placeholder: 0.0\n",
            known.platform
        );
        let differences = changes((&known.model, truth), (&known.prior, &known.prior), "");
        let mut lines: Vec<String> = differences
            .iter()
            .filter(|c| !c.key.starts_with("model.effects."))
            .filter_map(|c| Some(format!("      {}: {}\n", c.key.strip_prefix("model.")?, scalar(&c.value)?)))
            .collect();
        // Effects of a truth are whole: those that differ from the model's stand beside those that do not.
        let effects = truth.effects.iter().flat_map(|(id, values)| values.iter().map(move |v| (id, v)));
        lines.extend(effects.filter_map(|(id, (name, value))| {
            Some(format!("      effects.{id}.{name}: {}\n", scalar(&Value::Double(*value))?))
        }));
        text = text.replace("      simulated_for_design.placeholder: 0.0\n", &lines.concat());
        if !lines.is_empty() {
            let path = folder.join("truth").join(format!("{}.yaml", known.platform));
            whorl_files::write_file(&path, text)
                .with_context(|| format!("cannot write {}", path.display()))?;
        }
        Ok(stage)
    }

    /// Simulates an experiment; its run, which goes with the stage.
    pub fn simulated(&self, name: &str, yaml: &str) -> anyhow::Result<PathBuf> {
        let experiment = self.folder.join("experiments").join(format!("{name}.yaml"));
        whorl_files::write_file(&experiment, yaml)
            .with_context(|| format!("cannot write {}", experiment.display()))?;
        let run = self.folder.join(format!("run_{name}"));
        simulate::record_quietly(&experiment, Some(&self.folder), &run, 1)?;
        Ok(run)
    }

    /// Simulates an experiment and reads its measurements.
    pub fn rehearse(&self, name: &str, yaml: &str, model: &PlatformModel) -> anyhow::Result<Recording> {
        let run = self.simulated(name, yaml)?;
        let options = ReadOptions { platform: Some(&self.platform), model: Some(model), channels: None };
        let recording = read_run_with(&run, &options)?.into_iter().next().context("nothing was measured")?;
        // Makes room for the next run.
        let _ = std::fs::remove_dir_all(&run);
        Ok(recording)
    }
}

/// The text of the platform's own parameter file.
pub fn own_text(known: &KnownPlatform) -> anyhow::Result<String> {
    let name = format!("{}.yaml", known.platform);
    let in_folder = |file: &Path, folder: &str| file.parent().is_some_and(|p| p.ends_with(folder));
    let named = known
        .files
        .iter()
        .find(|f| f.file_name().is_some_and(|n| n == name.as_str()) && !in_folder(f, "truth"));
    let file = named.or(known.files.last()).context("there is no parameter file of the platform")?;
    whorl_files::read_text(file).with_context(|| format!("cannot read {}", file.display()))
}

/// A value in the notation of a parameter file.
fn scalar(value: &Value) -> Option<String> {
    // A YAML 1.1 reader takes 1e-7 for a word and 1.0e-7 for a number.
    let number = |x: &f64| {
        let text = format!("{x:?}");
        match text.split_once('e') {
            Some((digits, exponent)) if !digits.contains('.') => format!("{digits}.0e{exponent}"),
            _ => text,
        }
    };
    match value {
        Value::Double(x) => Some(number(x)),
        Value::DoubleArray(list) => {
            Some(format!("[{}]", list.iter().map(number).collect::<Vec<_>>().join(", ")))
        }
        _ => None,
    }
}

/// A folder for this user alone: in the temporary directory anybody may have been first.
fn new_folder() -> anyhow::Result<PathBuf> {
    loop {
        let number = STAGES.fetch_add(1, Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("whorl_next_{}_{number}", std::process::id()));
        match DirBuilder::new().mode(0o700).create(&folder) {
            Ok(()) => return Ok(folder),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error).with_context(|| format!("cannot create {}", folder.display())),
        }
    }
}
