//! `whorl campaign`: many runs, or one question to many recordings; tables and a page.

mod dask;
mod slurm;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Args;
use serde_json::json;
use whorl_campaign::Part;
use whorl_campaign::slurm::Job;
use whorl_campaign::work::{Folder, Tasks, work};
use whorl_commands::campaign::{Campaign, planned};
use whorl_objects::is_remote;

use crate::output::{JsonArgument, is_closed, say, shown};
use crate::progress;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Campaign file, over experiments, e.g. params/campaigns/compare_laws.yaml, or over recordings, e.g.
    /// params/campaigns/rediagnose.yaml; a name alone is one in params/campaigns/.
    #[arg(value_name = "NAME|FILE")]
    campaign: PathBuf,
    /// Folder of the campaign; an interrupted campaign goes on where it was; s3://BUCKET/PREFIX: in object storage [default: campaigns/<name of the file>].
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
    /// Who distributes the runs: threads of this machine; a Slurm cluster (an array job; submitted, followed, and what is missing
    /// submitted again); or the workers of a Dask scheduler, through the Python package.
    #[arg(long, value_enum, default_value_t = Engine::Local)]
    engine: Engine,
    /// Engine slurm: number of tasks of the array job.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    tasks: u64,
    /// Engine slurm: an option for sbatch, e.g. --sbatch=--partition=long; may be given several times.
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    sbatch: Vec<String>,
    /// Engine dask: the scheduler, e.g. tcp://scheduler:8786.
    #[arg(long, value_name = "ADDRESS", required_if_eq("engine", "dask"))]
    scheduler: Option<String>,
    /// Computes one part of the campaign, without tables: what a task of an engine runs.
    #[arg(long, value_name = "NUMBER/OF", value_parser = Part::parse, conflicts_with = "engine")]
    part: Option<Part>,
    /// Only list the runs or recordings.
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Version of the JSON output.
const SCHEMA: u32 = 1;
/// Time between two looks at whether the work has ended.
const LOOK: Duration = Duration::from_millis(10);
/// Time between two lines of progress.
const SHOW: Duration = Duration::from_millis(500);

/// Who distributes the runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Engine {
    Local,
    Slurm,
    Dask,
}

/// Carries out `whorl campaign`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let file = &file_of(&arguments.campaign, arguments.params.as_deref());
    let mut campaign = planned(file, arguments.params.as_deref(), arguments.seeds)?;
    if arguments.dry_run {
        return dry_run(&campaign, &arguments.json);
    }
    let name = file.file_stem().map_or_else(|| "campaign".into(), |s| s.to_string_lossy().into_owned());
    let out = arguments.out.clone().unwrap_or_else(|| Path::new("campaigns").join(&name));
    let folder = campaign.open(&out)?;
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let threads = arguments.threads.unwrap_or(cores);
    if threads == 0 {
        bail!("--threads is 0; allowed: at least 1");
    }

    let began = Instant::now();
    let here = AtomicU64::new(0);
    if let Some(part) = arguments.part {
        campaign.list(&folder, false)?;
        work(&folder, &campaign, part, threads, &here)?;
        let seconds = began.elapsed().as_secs_f64();
        say!("part {part}: {} {} in {seconds:.1} s", here.into_inner(), campaign.noun());
        return Ok(());
    }
    // Until the end of this function.
    let mut held = Some(folder.hold()?);
    let before = folder.done()?;
    campaign.list(&folder, true)?;
    let total = campaign.len();
    let job = slurm_job(arguments, &folder)?;
    match (arguments.engine, job.submitted()) {
        (Engine::Slurm, _) => slurm::distribute(&job, &folder, total, campaign.noun())?,
        (Engine::Local | Engine::Dask, Some(number)) => bail!(
            "job {number} on Slurm works on {}; --engine slurm follows it; to go on here: `scancel {number}`, and remove {}",
            folder.path().display(),
            folder.path().join("slurm/job").display()
        ),
        (Engine::Local, None) => on_threads(&folder, &campaign, threads, &here)?,
        (Engine::Dask, None) => {
            // The Python package directs the folder meanwhile.
            drop(held.take());
            let scheduler = arguments.scheduler.as_deref().unwrap_or_default();
            dask::distribute(arguments, scheduler, &folder.told(folder.path()))?;
            held = Some(folder.hold()?);
        }
    }
    let done = match arguments.engine {
        Engine::Slurm | Engine::Dask => {
            format!("{} {} on the cluster", folder.done()?.saturating_sub(before), campaign.noun())
        }
        Engine::Local => format!("{} {} here", here.into_inner(), campaign.noun()),
    };
    finish(&folder, &campaign, before, &done, began.elapsed(), &arguments.json)?;
    drop(held);
    Ok(())
}

/// The file of a campaign that is named or is a file; names are looked up in this folder's campaigns/, or in params/.
fn file_of(campaign: &Path, params: Option<&Path>) -> PathBuf {
    let folder = params.unwrap_or(Path::new("params")).join("campaigns");
    let is_name = campaign.components().count() == 1 && campaign.extension().is_none();
    if is_name && !campaign.exists() && folder.is_dir() {
        folder.join(campaign).with_extension("yaml")
    } else {
        campaign.to_owned()
    }
}

/// Computes what is missing, on so many threads, and shows how far it is.
fn on_threads(folder: &Folder, campaign: &Campaign, threads: usize, here: &AtomicU64) -> anyhow::Result<()> {
    progress::watched("computing", |say| {
        std::thread::scope(|scope| -> anyhow::Result<()> {
            let worker = scope.spawn(|| work(folder, campaign, Part::WHOLE, threads, here));
            let mut told = Instant::now();
            while !worker.is_finished() {
                std::thread::sleep(LOOK);
                if told.elapsed() >= SHOW {
                    told = Instant::now();
                    let done = folder.done().unwrap_or_else(|_| here.load(Ordering::Relaxed));
                    let share = done as f64 / campaign.len().max(1) as f64;
                    say(share, &format!("{done} of {} {}", campaign.len(), campaign.noun()));
                }
            }
            worker.join().unwrap_or_else(|_| Err(std::io::Error::other("a worker ended abnormally")))?;
            Ok(())
        })
    })
}

/// The array job: this program with these arguments, in this folder, for each part.
fn slurm_job(arguments: &Arguments, folder: &Folder) -> anyhow::Result<Job> {
    let text = |path: &Path| path.display().to_string();
    let program = std::env::current_exe().context("cannot find the path of this program")?;
    let mut command = vec![text(&program), "campaign".to_owned(), text(&arguments.campaign)];
    let out = folder.told(folder.path());
    command.extend(["--out".to_owned(), text(&out)]);
    if let Some(params) = &arguments.params {
        command.extend(["--params".to_owned(), text(params)]);
    }
    if let Some(seeds) = arguments.seeds {
        command.extend(["--seeds".to_owned(), seeds.to_string()]);
    }
    let name = arguments.campaign.file_stem().unwrap_or_default().to_string_lossy();
    let directory = std::env::current_dir().context("cannot find the working directory")?;
    // Slurm reads scripts and writes logs on a file system.
    let own = if is_remote(&out) { Path::new("campaigns").join(&*name) } else { folder.path().to_owned() };
    let beside =
        std::path::absolute(own.join("slurm")).with_context(|| format!("cannot use {}", own.display()))?;
    Ok(Job {
        name: format!("whorl-{name}"),
        command,
        directory,
        folder: beside,
        parts: arguments.tasks,
        options: arguments.sbatch.clone(),
    })
}

fn dry_run(campaign: &Campaign, json: &JsonArgument) -> anyhow::Result<()> {
    let lines = campaign.lines()?;
    for line in &lines {
        say!("{line}");
        if is_closed() {
            break;
        }
    }
    say!("{} {}", lines.len(), campaign.noun());
    json.write(|| Ok(json!({"schema": SCHEMA, (campaign.noun()): campaign.as_json()?})))
}

fn finish(
    folder: &Folder,
    campaign: &Campaign,
    before: u64,
    done: &str,
    elapsed: Duration,
    json: &JsonArgument,
) -> anyhow::Result<()> {
    let tables = campaign.write_tables(folder)?;
    say!(
        "{done} in {:.1} s{}; {} of {} {} are done",
        elapsed.as_secs_f64(),
        if before > 0 { format!(", {before} were already done") } else { String::new() },
        tables.rows,
        campaign.len(),
        campaign.noun()
    );
    for sentence in &tables.said {
        say!("  {sentence}");
    }
    say!("table: {}\nas Parquet: {}", tables.csv.display(), tables.parquet.display());
    for further in &tables.further {
        say!("  and: {}", further.display());
    }
    if let Some(page) = &tables.page {
        say!("page: {}", page.display());
    }
    json.write(|| {
        Ok(json!({
            "schema": SCHEMA, "of": campaign.len(), "done": tables.rows, "said": tables.said, "table": shown(&tables.csv),
            "parquet": shown(&tables.parquet), "further": tables.further.iter().map(|table| shown(table)).collect::<Vec<_>>(), "page": tables.page.as_deref().map(shown),
        }))
    })
}
