//! `whorl campaign`: many runs, percentiles, a page.

mod slurm;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Args;
use serde_json::{Map, Value, json};
use whorl_campaign::row::METRICS;
use whorl_campaign::slurm::Job;
use whorl_campaign::work::{Folder, work, work_part};
use whorl_campaign::{Part, Plan, Row, RunSpec};
use whorl_commands::campaign::{opened, planned, write_tables};

use crate::output::{JsonArgument, is_closed, say};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Campaign file, e.g. params/campaigns/compare_laws.yaml.
    #[arg(value_name = "FILE")]
    campaign: PathBuf,
    /// Folder of the campaign; an interrupted campaign is resumed, and several machines may share the folder [default:
    /// campaigns/<name of the file>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Parameter folder [default: the campaign file's ../, which is params/].
    #[arg(long, value_name = "DIR")]
    params: Option<PathBuf>,
    /// Number of runs in parallel [default: one for each core].
    #[arg(long, short = 'j', value_name = "N")]
    threads: Option<usize>,
    /// Number of seeds, instead of the file's.
    #[arg(long, value_name = "N")]
    seeds: Option<u64>,
    /// Who distributes the runs: threads of this machine, or a Slurm cluster (an array job; submitted, followed, and what is missing
    /// submitted again).
    #[arg(long, value_enum, default_value_t = Engine::Local)]
    engine: Engine,
    /// Engine slurm: number of tasks of the array job.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    tasks: u64,
    /// Engine slurm: an option for sbatch, e.g. --sbatch=--partition=long; may be given several times.
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    sbatch: Vec<String>,
    /// Computes one part of the campaign, without tables: what a task of an engine runs.
    #[arg(long, value_name = "NUMBER/OF", value_parser = Part::parse, conflicts_with = "engine")]
    part: Option<Part>,
    /// Only list the runs.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Who distributes the runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Engine {
    Local,
    Slurm,
}

/// Carries out `whorl campaign`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let file = &arguments.campaign;
    let plan = planned(file, arguments.params.as_deref(), arguments.seeds)?;
    if arguments.dry_run {
        return dry_run(&plan, &arguments.json);
    }
    let name = file.file_stem().map_or_else(|| "campaign".into(), |s| s.to_string_lossy().into_owned());
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("campaigns").join(&name));
    let folder = opened(&out, &plan)?;
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = arguments.threads.unwrap_or(cores);
    if threads == 0 {
        bail!("--threads is 0; allowed: at least 1");
    }

    let before = folder.done()?;
    let began = Instant::now();
    let here = AtomicU64::new(0);
    if let Some(part) = arguments.part {
        work_part(&folder, &plan, part, threads, &here)?;
        say!("part {part}: {} runs in {:.1} s", here.into_inner(), began.elapsed().as_secs_f64());
        return Ok(());
    }
    if arguments.engine == Engine::Slurm {
        slurm::distribute(&slurm_job(arguments, &folder)?, &folder, &plan)?;
        let there = folder.done()?.saturating_sub(before);
        let done = format!("{there} runs on the cluster");
        return finish(&folder, &plan, before, &done, began.elapsed(), &arguments.json);
    }
    std::thread::scope(|scope| -> anyhow::Result<()> {
        let worker = scope.spawn(|| work(&folder, &plan, threads, &here));
        while !worker.is_finished() {
            std::thread::sleep(Duration::from_millis(200));
            progress(&folder, &plan, began, here.load(Ordering::Relaxed));
        }
        worker.join().unwrap_or_else(|_| Err(std::io::Error::other("a worker ended abnormally")))?;
        Ok(())
    })?;
    if std::io::stderr().is_terminal() {
        eprintln!();
    }
    let done = format!("{} runs here", here.into_inner());
    finish(&folder, &plan, before, &done, began.elapsed(), &arguments.json)
}

/// The array job: this program with these arguments, in this folder, for each part.
fn slurm_job(arguments: &Arguments, folder: &Folder) -> anyhow::Result<Job> {
    let text = |path: &Path| path.display().to_string();
    let program = std::env::current_exe().context("cannot find the path of this program")?;
    let mut command = vec![text(&program), "campaign".to_owned(), text(&arguments.campaign)];
    command.extend(["--out".to_owned(), text(folder.path())]);
    if let Some(params) = &arguments.params {
        command.extend(["--params".to_owned(), text(params)]);
    }
    if let Some(seeds) = arguments.seeds {
        command.extend(["--seeds".to_owned(), seeds.to_string()]);
    }
    let name = arguments.campaign.file_stem().unwrap_or_default().to_string_lossy();
    let directory = std::env::current_dir().context("cannot find the working directory")?;
    let beside = std::path::absolute(folder.path().join("slurm"))
        .with_context(|| format!("cannot use {}", folder.path().display()))?;
    Ok(Job {
        name: format!("whorl-{name}"),
        command,
        directory,
        folder: beside,
        parts: arguments.tasks,
        options: arguments.sbatch.clone(),
    })
}

fn dry_run(plan: &Plan, json: &JsonArgument) -> anyhow::Result<()> {
    for spec in (0..plan.len()).map_while(|index| plan.run(index)) {
        say!("{:6}  {}  seed {}  {}", spec.index, spec.experiment, spec.seed, spec.labels.join("  "));
        if is_closed() {
            break;
        }
    }
    say!("{} runs", plan.len());
    let axes: Vec<&str> = plan.definition.axes.iter().map(|axis| axis.name.as_str()).collect();
    json.write(|| {
        let runs = (0..plan.len()).map_while(|index| plan.run(index));
        let run = |spec: RunSpec| {
            let swept: Map<String, Value> = axes
                .iter()
                .zip(spec.labels)
                .map(|(axis, label)| ((*axis).to_owned(), label.into()))
                .collect();
            json!({"run": spec.index, "experiment": spec.experiment, "seed": spec.seed, "swept": swept})
        };
        Ok(json!({"schema": 1, "name": plan.definition.name, "runs": runs.map(run).collect::<Vec<_>>()}))
    })
}

fn progress(folder: &Folder, plan: &Plan, began: Instant, here: u64) {
    if !std::io::stderr().is_terminal() {
        return;
    }
    let done = folder.done().unwrap_or(here);
    let share = done as f64 / plan.len().max(1) as f64;
    let bars = (share * 30.0) as usize;
    let left = if here > 0 {
        let left_s = began.elapsed().as_secs_f64() / here as f64 * plan.len().saturating_sub(done) as f64;
        format!("{:.0} min {:02.0} s left", (left_s / 60.0).floor(), left_s % 60.0)
    } else {
        String::new()
    };
    eprint!("\r[{:<30}] {done}/{} runs, {left}      ", "#".repeat(bars.min(30)), plan.len());
}

fn finish(
    folder: &Folder,
    plan: &Plan,
    before: u64,
    done: &str,
    elapsed: Duration,
    json: &JsonArgument,
) -> anyhow::Result<()> {
    let rows = folder.rows(plan)?;
    let tables = write_tables(folder, plan, &rows)?;
    let simulated_s: f64 = rows.iter().filter_map(|r| r.metrics.first()).filter(|v| v.is_finite()).sum();
    say!(
        "{done} in {:.1} s{}; {} of {} runs are done, {:.0} s simulated in all",
        elapsed.as_secs_f64(),
        if before > 0 { format!(", {before} were already done") } else { String::new() },
        rows.len(),
        plan.len(),
        simulated_s
    );
    let unfinished = rows.iter().filter(|r| r.outcome != "finished");
    for row in unfinished.clone().take(5) {
        say!(
            "  run {} ({}, seed {}, {}): {}: {}",
            row.index,
            row.experiment,
            row.seed,
            row.labels.join(", "),
            row.outcome,
            row.reason
        );
    }
    let more = unfinished.count();
    if more > 5 {
        say!("  and {} more that did not finish", more - 5);
    }
    say!(
        "table: {}\nas Parquet: {}\npage: {}",
        tables.csv.display(),
        tables.parquet.display(),
        tables.page.display()
    );
    json.write(|| {
        // null where there is no number, as in the table.
        let run = |row: &Row| {
            let metrics: Map<String, Value> =
                METRICS.iter().zip(&row.metrics).map(|(name, v)| ((*name).to_owned(), json!(v))).collect();
            json!({"run": row.index, "experiment": row.experiment, "seed": row.seed, "swept": row.labels,
                "outcome": row.outcome, "reason": row.reason, "metrics": metrics})
        };
        Ok(json!({
            "schema": 1, "name": plan.definition.name, "of": plan.len(),
            "table": tables.csv, "parquet": tables.parquet, "page": tables.page,
            "runs": rows.iter().map(run).collect::<Vec<_>>(),
        }))
    })
}
