//! `whorl import`: measurements of other systems as run directories.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use clap::{Args, Subcommand};
use serde_json::json;
use sha2::{Digest, Sha256};
use whorl_bag::CsvMap;
use whorl_node::Timestamp;
use whorl_recording::{
    KnownPlatform, Mounting, ReadOptions, Recording, RunOrigin, platform_parts, read_csv_beginning,
    read_model, read_run_with, write_long_csv, write_run,
};

use crate::output::{JsonArgument, say, shown};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    source: Source,
}

#[derive(Debug, Subcommand)]
enum Source {
    /// Imports a CSV file, plain or compressed with gzip.
    Csv(SourceArguments),
    /// Imports a rosbag2 bag whose topics have other names.
    Bag(SourceArguments),
}

#[derive(Debug, Args)]
struct SourceArguments {
    /// Recorded file (or bag directory).
    file: PathBuf,
    /// Map of columns or topics with their units and order: docs/recordings.md.
    #[arg(long, value_name = "MAP.yaml")]
    channels: PathBuf,
    /// Parameter file of the measured platform, e.g. params/whorl_1.yaml.
    #[arg(long, value_name = "PLATFORM.yaml")]
    platform: PathBuf,
    /// Run directory to write; must not hold a run yet.
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// The body was clamped and only the wheels moved.
    #[arg(long)]
    clamped: bool,
    /// A controller was running.
    #[arg(long)]
    closed_loop: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Lines of a file that are kept in memory: 55 min at 100 Hz. What comes behind is read, checked and written line by line.
const KEPT_LINES: u64 = 330_000;
/// Largest number of ignored columns to list.
const MOST_NAMES: usize = 20;

/// Carries out `whorl import`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    match &arguments.source {
        Source::Csv(arguments) => {
            let known = read_model(&arguments.platform, None)?;
            let map = CsvMap::load_for(&arguments.channels, &platform_parts(&known))?;
            let mut imported = read_csv_beginning(&arguments.file, &map, &known, KEPT_LINES)?;
            say!(
                "{}: {} lines, {:.1} s of {}",
                arguments.file.display(),
                imported.rows,
                imported.duration_s,
                known.platform
            );
            for (channel, samples) in &imported.channels {
                say!("  {channel:<22} {samples:>9}");
            }
            if !imported.ignored.is_empty() {
                let shown: Vec<&str> = imported.ignored.iter().take(MOST_NAMES).map(String::as_str).collect();
                let more = imported.ignored.len() - shown.len();
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                say!("ignored, because the map does not name them: {}{more}", shown.join(", "));
            }
            if !imported.is_whole {
                say!(
                    "note: The file is long: units, signs and frozen sensors were looked at in its first {KEPT_LINES} lines."
                );
            }
            check(arguments, &known, &mut imported.recording)?;
            let origin = origin(arguments, &[&arguments.file, &arguments.channels])?;
            let path = if imported.is_whole {
                write_run(&imported.recording, &known, &origin, &arguments.out)?
            } else {
                write_long_csv(&arguments.file, &map, &imported, &known, &origin, &arguments.out)?
            };
            answer(arguments, &known, &imported.recording, imported.duration_s, &path)
        }
        Source::Bag(arguments) => {
            let known = read_model(&arguments.platform, None)?;
            let options = ReadOptions {
                platform: Some(&known.platform),
                model: Some(&known.model),
                channels: Some(&arguments.channels),
            };
            let recordings = read_run_with(&arguments.file, &options)?;
            let mut recording = recordings.into_iter().next().context("the bag holds no platform")?;
            say!("{}: {:.1} s of {}", arguments.file.display(), recording.duration_s(), known.platform);
            check(arguments, &known, &mut recording)?;
            let path =
                write_run(&recording, &known, &origin(arguments, &[&arguments.channels])?, &arguments.out)?;
            answer(arguments, &known, &recording, recording.duration_s(), &path)
        }
    }
}

/// Says what is odd about a recording and what it lacks.
fn check(
    arguments: &SourceArguments,
    known: &KnownPlatform,
    recording: &mut Recording,
) -> anyhow::Result<()> {
    if arguments.clamped {
        recording.mounting = Mounting::Clamped;
    }
    recording.closed_loop |= arguments.closed_loop;
    recording.check_fits(&known.model, &known.platform)?;
    for remark in &recording.remarks {
        say!("note: {remark}");
    }
    for cost in recording.missing_channels(&known.model) {
        say!("missing: {cost}");
    }
    Ok(())
}

fn origin(arguments: &SourceArguments, sources: &[&Path]) -> anyhow::Result<RunOrigin> {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut notes = vec![("imported_from".to_owned(), arguments.file.display().to_string())];
    for source in sources {
        notes.push((format!("sha256 of {}", source.display()), sha256(source)?));
    }
    Ok(RunOrigin {
        experiment: arguments.file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        start_utc: Timestamp(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX)),
        notes,
    })
}

fn answer(
    arguments: &SourceArguments,
    known: &KnownPlatform,
    recording: &Recording,
    duration_s: f64,
    path: &Path,
) -> anyhow::Result<()> {
    let copy = path.join("channels.yaml");
    let map = whorl_files::read_text(&arguments.channels)
        .with_context(|| format!("cannot read {}", arguments.channels.display()))?;
    whorl_files::write_file(&copy, map).with_context(|| format!("cannot write {}", copy.display()))?;
    say!("run directory: {}", path.display());
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1, "run": shown(path), "platform": known.platform, "duration_s": duration_s,
            "remarks": recording.remarks, "missing": recording.missing_channels(&known.model),
        }))
    })
}

fn sha256(path: &Path) -> anyhow::Result<String> {
    let unreadable = || format!("cannot read {}", path.display());
    let mut file = whorl_files::open_file(path).with_context(unreadable)?;
    let (mut digest, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match file.read(&mut part).with_context(unreadable)? {
            0 => break,
            length => digest.update(part.get(..length).unwrap_or_default()),
        }
    }
    Ok(digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
