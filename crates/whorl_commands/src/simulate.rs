//! An experiment in one process, deterministic, recorded like a real one.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use whorl_bag::{BackgroundRunWriter, BagError, BagOptions, RunDescription, RunWriter};
use whorl_msgs::topics::{Message, Route};
use whorl_node::{LogLevel, LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, layers_of_experiment};
use whorl_sim::{NodeSet, Observer, Outcome, run as run_simulation};

/// Where a run is recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Record {
    /// Nowhere.
    Nothing,
    /// In this directory, which must not hold a run yet.
    Into(PathBuf),
    /// In a new directory beneath this one, named after time and experiment.
    Beneath(PathBuf),
}

/// What is to be simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Experiment file.
    pub experiment: PathBuf,
    /// Where it is recorded.
    pub record: Record,
    /// Seed of all noise: same seed, same parameters, same run to the bit.
    pub seed: u64,
    /// Parameter folder; `None`: the experiment file's `../`.
    pub params: Option<PathBuf>,
    /// Overrides of parameters of the files, `node:key:=value`.
    pub overrides: Vec<String>,
    /// Longest simulated time \[s\].
    pub longest_s: f64,
}

/// A run that was simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// How it ended.
    pub outcome: Outcome,
    /// How many messages were published.
    pub messages: u64,
    /// The run directory, if one was written.
    pub path: Option<PathBuf>,
}

/// Records what is published and keeps warnings.
struct Recording {
    writer: Option<BackgroundRunWriter>,
    verbose: bool,
    messages: u64,
}

impl Observer for Recording {
    type Error = BagError;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), BagError> {
        self.messages += 1;
        match &mut self.writer {
            Some(writer) => writer.write_message(route, now, message),
            None => Ok(()),
        }
    }

    fn logged(&mut self, now: Timestamp, node: &str, line: &LogLine) {
        if self.verbose || line.level == LogLevel::Error {
            // The simulation goes on if a log line cannot be written.
            let _ = writeln!(std::io::stderr(), "[{:9.3} s] {node}: {}", now.seconds(), line.text);
        }
    }
}

impl Simulation {
    /// Simulates; `clock` gives the time of day for the manifest, `progress` gets the simulated time so far \[s\].
    /// Errors of nodes go to the error stream, with `verbose` everything that they log.
    ///
    /// # Errors
    /// Wrong parameters, a directory that cannot be written.
    pub fn run(
        &self,
        verbose: bool,
        clock: impl Fn() -> Timestamp,
        progress: &mut dyn FnMut(f64),
    ) -> anyhow::Result<Simulated> {
        let layers = self.layers()?;
        let overrides =
            self.overrides.iter().map(|text| Override::parse(text)).collect::<Result<Vec<_>, _>>()?;
        let tree = ParameterTree::load(&layers, &overrides)?;
        tree.check_overrides()?;
        let mut set = NodeSet::build(&tree, self.seed, Timestamp(0))?;
        let writer = self.open_run(&set, &layers, clock())?;
        let path = writer.as_ref().map(|w| w.path().to_owned());
        let writer = writer.map(BackgroundRunWriter::new);
        let mut recording = Recording { writer, verbose, messages: 0 };
        let longest = Duration::from_secs_f64(self.longest_s);
        let simulated = run_simulation(&mut set, longest, &mut recording, progress);
        // Closed even when the simulation failed, most often because of the recording itself.
        if let Some(writer) = recording.writer {
            writer.finish(clock())?;
        }
        Ok(Simulated { outcome: simulated?, messages: recording.messages, path })
    }

    fn layers(&self) -> anyhow::Result<Vec<PathBuf>> {
        let experiment = &self.experiment;
        if !experiment.is_file() {
            bail!("{} {}", experiment.display(), whorl_params::missing(experiment));
        }
        let folder = match &self.params {
            Some(folder) => folder.clone(),
            None => experiment
                .parent()
                .and_then(Path::parent)
                .filter(|folder| folder.join("common.yaml").is_file())
                .map(Path::to_owned)
                .with_context(|| {
                    format!("{} is not in a folder experiments/ beside a common.yaml; name the parameter folder with --params", experiment.display())
                })?,
        };
        Ok(layers_of_experiment(&folder, experiment)?)
    }

    fn open_run(
        &self,
        set: &NodeSet,
        layers: &[PathBuf],
        now: Timestamp,
    ) -> anyhow::Result<Option<RunWriter>> {
        let name = self.experiment.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        let description = RunDescription {
            experiment: name,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            seed: Some(self.seed),
            simulated_time: true,
            platforms: set.platforms.clone(),
            ..RunDescription::default()
        };
        let options = BagOptions::default();
        let mut writer = match &self.record {
            Record::Nothing => return Ok(None),
            Record::Into(out) => RunWriter::create_in(out, description, now, options)?,
            Record::Beneath(folder) => RunWriter::create(folder, description, now, options)?,
        };
        writer.add_parameter_files(layers)?;
        writer.add_parameters(
            "effective.yaml",
            "the parameters in force",
            set.effective_parameters.as_bytes(),
        )?;
        Ok(Some(writer))
    }
}

/// Simulates an experiment into a run directory without a report, to analyse its motion.
///
/// # Errors
/// As [`Simulation::run`].
pub fn record_quietly(experiment: &Path, params: Option<&Path>, out: &Path, seed: u64) -> anyhow::Result<()> {
    let simulation = Simulation {
        experiment: experiment.to_owned(),
        record: Record::Into(out.to_owned()),
        seed,
        params: params.map(Path::to_owned),
        overrides: Vec::new(),
        longest_s: 3600.0,
    };
    simulation.run(false, utc_now, &mut |_| {}).map(|_| ())
}

/// The time of day.
#[must_use]
pub fn utc_now() -> Timestamp {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX))
}
