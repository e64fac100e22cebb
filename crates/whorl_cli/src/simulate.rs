//! `whorl simulate`: an experiment in one process, deterministic, recorded like a real one.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::bail;
use clap::Args;
use serde_json::json;
pub use whorl_commands::simulate::record_quietly;
use whorl_commands::simulate::{Record, Simulation};
use whorl_math::words::shell_word;

use crate::output::{JsonArgument, say, shown};
use crate::{progress, report};

#[derive(Debug, Args)]
pub struct Arguments {
    /// A name in params/experiments/, or a file.
    #[arg(long, value_name = "NAME|FILE")]
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
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl simulate`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if !(arguments.longest > 0.0 && arguments.longest.is_finite()) {
        bail!("--longest is {}; allowed: a positive number of seconds", arguments.longest);
    }
    let record = match &arguments.out {
        _ if arguments.no_record => Record::Nothing,
        Some(out) => Record::Into(out.clone()),
        None => Record::Beneath(PathBuf::from("runs")),
    };
    let simulation = Simulation {
        experiment: experiment_file(&arguments.experiment, arguments.params.as_deref())?,
        record,
        seed: arguments.seed,
        params: arguments.params.clone(),
        overrides: arguments.overrides.clone(),
        longest_s: arguments.longest,
    };
    let began = Instant::now();
    let simulated = progress::watched("simulating", |say| {
        let mut said = began;
        simulation.run(arguments.verbose, whorl_ros::wall_clock, &mut |simulated_s| {
            // Every step of the simulation comes by here.
            if said.elapsed() >= Duration::from_millis(100) {
                said = Instant::now();
                let factor = simulated_s / began.elapsed().as_secs_f64();
                // How long the experiment takes is known at its end.
                say(0.0, &format!("simulated {simulated_s:.1} s, {factor:.0} times real time"));
            }
        })
    })?;
    let elapsed_s = began.elapsed().as_secs_f64();
    say!(
        "simulated {:.1} s in {elapsed_s:.2} s ({:.0} times real time), {} messages{}",
        simulated.outcome.simulated_s,
        simulated.outcome.simulated_s / elapsed_s,
        simulated.messages,
        if simulated.outcome.finished { "" } else { "; the experiment had not ended by itself" }
    );
    let mut report = None;
    if let Some(path) = &simulated.path {
        say!("run directory: {}", path.display());
        if !arguments.no_report {
            let written = progress::during("writing the report", || report::write(path, None))?;
            report::print(&written);
            say!("next: whorl compare {}", shell_word(&shown(path)));
            report = Some((report::as_json(path, &written)?, written.verdict.failed()));
        }
    }
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1,
            "simulated_s": simulated.outcome.simulated_s,
            "elapsed_s": elapsed_s,
            "messages": simulated.messages,
            "finished": simulated.outcome.finished,
            "run": simulated.path.as_deref().map(shown),
            "report": report.as_ref().map(|(summary, _)| summary),
        }))
    })?;
    if report.is_some_and(|(_, failed)| failed) {
        bail!("the run failed; its verdict says why");
    }
    Ok(())
}

/// The file of an experiment that is named or is a file; names are looked up in this folder, or in params/.
pub fn experiment_file(experiment: &Path, params: Option<&Path>) -> anyhow::Result<PathBuf> {
    let folder = params.unwrap_or(Path::new("params"));
    Ok(whorl_launch::find_experiment(&experiment.to_string_lossy(), &[folder])?)
}
