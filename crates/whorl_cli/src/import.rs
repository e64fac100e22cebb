//! `whorl import`: measurements of other systems as run directories.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use clap::{Args, Subcommand};
use serde_json::json;
use sha2::{Digest, Sha256};
use whorl_bag::CsvMap;
use whorl_node::Timestamp;
use whorl_recording::{
    KnownPlatform, Mounting, ReadOptions, Recording, RunOrigin, platform_parts, read_csv, read_model,
    read_run_with, write_run,
};

use crate::output::{JsonArgument, say};

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

/// Largest number of ignored columns to list.
const MOST_NAMES: usize = 20;

/// Carries out `whorl import`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    match &arguments.source {
        Source::Csv(arguments) => {
            let known = read_model(&arguments.platform, None)?;
            let map = CsvMap::load_for(&arguments.channels, &platform_parts(&known))?;
            let imported = read_csv(&arguments.file, &map, &known)?;
            say!(
                "{}: {} lines, {:.1} s of {}",
                arguments.file.display(),
                imported.rows,
                imported.recording.duration_s(),
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
            finish(arguments, &known, imported.recording, &[&arguments.file, &arguments.channels])
        }
        Source::Bag(arguments) => {
            let known = read_model(&arguments.platform, None)?;
            let options = ReadOptions {
                platform: Some(&known.platform),
                model: Some(&known.model),
                channels: Some(&arguments.channels),
            };
            let recordings = read_run_with(&arguments.file, &options)?;
            let recording = recordings.into_iter().next().context("the bag holds no platform")?;
            say!("{}: {:.1} s of {}", arguments.file.display(), recording.duration_s(), known.platform);
            finish(arguments, &known, recording, &[&arguments.channels])
        }
    }
}

fn finish(
    arguments: &SourceArguments,
    known: &KnownPlatform,
    mut recording: Recording,
    sources: &[&Path],
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
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let mut notes = vec![("imported_from".to_owned(), arguments.file.display().to_string())];
    for source in sources {
        notes.push((format!("sha256 of {}", source.display()), sha256(source)?));
    }
    let origin = RunOrigin {
        experiment: arguments.file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        start_utc: Timestamp(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX)),
        notes,
    };
    let path = write_run(&recording, known, &origin, &arguments.out)?;
    let copy = path.join("channels.yaml");
    std::fs::copy(&arguments.channels, &copy).with_context(|| format!("cannot write {}", copy.display()))?;
    say!("run directory: {}", path.display());
    arguments.json.write(|| {
        Ok(json!({
            "schema": 1, "run": path, "platform": known.platform, "duration_s": recording.duration_s(),
            "remarks": recording.remarks, "missing": recording.missing_channels(&known.model),
        }))
    })
}

fn sha256(path: &Path) -> anyhow::Result<String> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}
