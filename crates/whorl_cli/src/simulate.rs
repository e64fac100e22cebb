//! `whorl simulate`: an experiment in one process, deterministic, recorded like a real one.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use clap::Args;
use whorl_bag::{BackgroundRunWriter, BagError, BagOptions, RunDescription, RunWriter};
use whorl_msgs::topics::{Message, Route};
use whorl_node::{LogLevel, LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, layers_of_experiment};
use whorl_sim::{NodeSet, Observer, run as run_simulation};

use crate::report;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Experiment file, e.g. params/experiments/leader_follower.yaml.
    #[arg(long, value_name = "FILE")]
    experiment: PathBuf,
    /// Run directory to write; must not hold a run yet [default: runs/<UTC time>_<experiment>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of all noise: same seed, same parameters, same run to the bit.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Parameter folder [default: the experiment file's ../, which is params/].
    #[arg(long, value_name = "DIR")]
    params: Option<PathBuf>,
    /// Overrides a parameter of the files, as for the nodes: -p /coordinator:law.kind:=decentralised; may be repeated.
    #[arg(short = 'p', value_name = "NODE:KEY:=VALUE")]
    overrides: Vec<String>,
    /// Longest simulated time [s]; an experiment normally ends by itself.
    #[arg(long, value_name = "SECONDS", default_value_t = 3600.0)]
    longest: f64,
    /// Do not record: only simulate and report the speed.
    #[arg(long, conflicts_with = "out")]
    no_record: bool,
    /// Do not write the report.
    #[arg(long)]
    no_report: bool,
    /// Print the nodes' log lines.
    #[arg(long, short)]
    verbose: bool,
    /// Prints nothing about the run: it is a step of another command.
    #[arg(skip)]
    quiet: bool,
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

/// Carries out `whorl simulate`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if !(arguments.longest > 0.0 && arguments.longest.is_finite()) {
        bail!("--longest is {}; allowed: a positive number of seconds", arguments.longest);
    }
    let layers = layers(arguments)?;
    let overrides =
        arguments.overrides.iter().map(|text| Override::parse(text)).collect::<Result<Vec<_>, _>>()?;
    let tree = ParameterTree::load(&layers, &overrides)?;
    let mut set = NodeSet::build(&tree, arguments.seed, Timestamp(0))?;
    let experiment =
        arguments.experiment.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let writer =
        if arguments.no_record { None } else { Some(open_run(arguments, &experiment, &set, &layers)?) };
    let path = writer.as_ref().map(|w| w.path().to_owned());
    let writer = writer.map(BackgroundRunWriter::new);
    let mut recording = Recording { writer, verbose: arguments.verbose, messages: 0 };

    let began = Instant::now();
    let mut shown = None;
    let simulated =
        run_simulation(&mut set, Duration::from_secs_f64(arguments.longest), &mut recording, |simulated_s| {
            progress(&mut shown, began, simulated_s);
        });
    if shown.is_some() {
        eprintln!();
    }
    // Closed even when the simulation failed, most often because of the recording itself.
    if let Some(writer) = recording.writer {
        writer.finish(utc_now())?;
    }
    let outcome = simulated?;
    if arguments.quiet {
        return Ok(());
    }
    let elapsed_s = began.elapsed().as_secs_f64();
    println!(
        "simulated {:.1} s in {elapsed_s:.2} s ({:.0} times real time), {} messages{}",
        outcome.simulated_s,
        outcome.simulated_s / elapsed_s,
        recording.messages,
        if outcome.finished { "" } else { "; the experiment had not ended by itself" }
    );
    let Some(path) = path else { return Ok(()) };
    println!("run directory: {}", path.display());
    if !arguments.no_report {
        let report = report::write(&path, None)?;
        report::print(&report);
        if report.verdict.failed() {
            bail!("the run failed; its verdict says why");
        }
    }
    Ok(())
}

/// Simulates an experiment into a run directory without messages or a report, to analyse its motion.
pub fn record_quietly(experiment: &Path, params: Option<&Path>, out: &Path, seed: u64) -> anyhow::Result<()> {
    run(&Arguments {
        experiment: experiment.to_owned(),
        out: Some(out.to_owned()),
        seed,
        params: params.map(Path::to_owned),
        overrides: Vec::new(),
        longest: 3600.0,
        no_record: false,
        no_report: true,
        verbose: false,
        quiet: true,
    })
}

fn layers(arguments: &Arguments) -> anyhow::Result<Vec<PathBuf>> {
    let experiment = &arguments.experiment;
    if !experiment.is_file() {
        bail!("no experiment file {}", experiment.display());
    }
    let folder = match &arguments.params {
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
    arguments: &Arguments,
    experiment: &str,
    set: &NodeSet,
    layers: &[PathBuf],
) -> anyhow::Result<RunWriter> {
    let description = RunDescription {
        experiment: experiment.to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        seed: Some(arguments.seed),
        simulated_time: true,
        platforms: set.platforms.clone(),
        ..RunDescription::default()
    };
    let options = BagOptions::default();
    let mut writer = match &arguments.out {
        Some(out) => RunWriter::create_in(out, description, utc_now(), options)?,
        None => RunWriter::create(Path::new("runs"), description, utc_now(), options)?,
    };
    for layer in layers {
        writer.add_parameter_file(layer)?;
    }
    for file in whorl_params::effect_files_beside(layers) {
        writer.add_effect_file(&file)?;
    }
    writer.add_parameters(
        "effective.yaml",
        "the parameters in force",
        set.effective_parameters.as_bytes(),
    )?;
    Ok(writer)
}

/// Shows the simulated time so far on a terminal, after one second.
fn progress(shown: &mut Option<Instant>, began: Instant, simulated_s: f64) {
    let now = Instant::now();
    let due = shown.map_or(began + Duration::from_secs(1), |last| last + Duration::from_millis(200));
    if now >= due && std::io::stderr().is_terminal() {
        *shown = Some(now);
        let factor = simulated_s / began.elapsed().as_secs_f64();
        eprint!("\rsimulated {simulated_s:7.1} s, {factor:5.0} times real time");
    }
}

fn utc_now() -> Timestamp {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX))
}
