//! `whorl export`: recordings for other programs.

use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Args, Subcommand};
use serde_json::json;
use whorl_bag::{PlatformParts, RunDirectory};
use whorl_commands::tables::write_recording;
use whorl_recording::{export_csv, platform_parts, read_model, read_run};

use crate::output::{JsonArgument, say, shown};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    form: Form,
}

#[derive(Debug, Subcommand)]
enum Form {
    /// Writes the measurements of each platform as CSV, with the channel map for `whorl import csv`.
    Csv(CsvArguments),
    /// Writes the measurements of runs as Parquet, one file for each channel, in folders that DuckDB, Polars, pandas, Spark and
    /// MATLAB read as one table.
    Parquet(ParquetArguments),
}

#[derive(Debug, Args)]
struct ParquetArguments {
    /// Run directories, rosbag2 directories or .mcap files.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Only this platform [default: all].
    #[arg(long, value_name = "NAME")]
    platform: Option<String>,
    /// Folder for the files; created if it does not exist. A run that it holds already is replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    json: JsonArgument,
}

#[derive(Debug, Args)]
struct CsvArguments {
    /// Run directory, rosbag2 directory or .mcap file.
    run: PathBuf,
    /// Only this platform [default: all].
    #[arg(long, value_name = "NAME", conflicts_with = "topics")]
    platform: Option<String>,
    /// Folder for the files; created if it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Writes one file for each topic instead, with all fields of its messages.
    #[arg(long)]
    topics: bool,
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl export`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    match &arguments.form {
        Form::Csv(arguments) if arguments.topics => topics(arguments),
        Form::Csv(arguments) => csv(arguments),
        Form::Parquet(arguments) => parquet(arguments),
    }
}

/// Names of the platform's wheels and jets; a plain bag has no parameters: they are numbered.
fn names(run: &Path, platform: &str) -> PlatformParts {
    read_model(run, Some(platform)).map_or_else(|_| PlatformParts::default(), |known| platform_parts(&known))
}

fn parquet(arguments: &ParquetArguments) -> anyhow::Result<()> {
    let mut files = Vec::new();
    for run in &arguments.runs {
        for recording in read_run(run, arguments.platform.as_deref())? {
            let names = names(run, &recording.platform);
            let written = write_recording(&recording, &names.wheels, &names.jets, &arguments.out)?;
            for remark in &recording.remarks {
                say!("{}, {}: note: {remark}", recording.name, recording.platform);
            }
            let rows: usize = written.iter().map(|table| table.rows).sum();
            let channels: Vec<&str> = written.iter().map(|table| table.holds.as_str()).collect();
            say!("{}, {}: {rows} rows: {}", recording.name, recording.platform, channels.join(", "));
            files.extend(written.iter().map(|table| {
                json!({"run": recording.name, "platform": recording.platform, "holds": table.holds,
                    "rows": table.rows, "file": shown(&table.path)})
            }));
        }
    }
    let out = arguments.out.display();
    say!(
        "A channel over all runs: SELECT * FROM read_parquet('{out}/gyro/**/*.parquet', hive_partitioning = true)"
    );
    arguments.json.write(|| Ok(files))
}

fn csv(arguments: &CsvArguments) -> anyhow::Result<()> {
    let mut files = Vec::new();
    for recording in read_run(&arguments.run, arguments.platform.as_deref())? {
        let names = names(&arguments.run, &recording.platform);
        let exported = export_csv(&recording, &names.wheels, &names.jets, &arguments.out)?;
        for remark in &recording.remarks {
            say!("{}: note: {remark}", recording.platform);
        }
        say!(
            "{}: {} lines in {}, columns explained in {}",
            recording.platform,
            exported.rows,
            exported.csv.display(),
            exported.map.display()
        );
        files.push(
            json!({"platform": recording.platform, "rows": exported.rows, "file": shown(&exported.csv),
            "channels": shown(&exported.map)}),
        );
    }
    arguments.json.write(|| Ok(files))
}

fn topics(arguments: &CsvArguments) -> anyhow::Result<()> {
    let bag = RunDirectory::open(&arguments.run)?.bag()?;
    let exported = whorl_bag::export_csv(&bag, &arguments.out)?;
    if exported.is_empty() {
        bail!("{} has no topics", arguments.run.display());
    }
    let files: Vec<_> = exported
        .iter()
        .map(|topic| json!({"topic": topic.topic, "rows": topic.rows, "file": topic.file.as_deref().map(shown)}))
        .collect();
    for topic in exported {
        match topic.file {
            Some(file) => say!("{}: {} lines in {}", topic.topic, topic.rows, file.display()),
            None => say!("{}: left out, the type of its messages is not known", topic.topic),
        }
    }
    arguments.json.write(|| Ok(files))
}
