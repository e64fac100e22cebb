//! `whorl export`: recordings for other programs.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Args, Subcommand};
use whorl_bag::{PlatformParts, RunDirectory};
use whorl_recording::{export_csv, platform_parts, read_model, read_run};

#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    form: Form,
}

#[derive(Debug, Subcommand)]
enum Form {
    /// Writes the measurements of each platform as CSV, with the channel map for `whorl import csv`.
    Csv(CsvArguments),
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
}

/// Carries out `whorl export`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Form::Csv(arguments) = &arguments.form;
    if arguments.topics {
        return topics(arguments);
    }
    for recording in read_run(&arguments.run, arguments.platform.as_deref())? {
        // A plain bag has no parameters: its columns are numbered.
        let names = read_model(&arguments.run, Some(&recording.platform))
            .map_or_else(|_| PlatformParts::default(), |known| platform_parts(&known));
        let exported = export_csv(&recording, &names.wheels, &names.jets, &arguments.out)?;
        for remark in &recording.remarks {
            println!("{}: note: {remark}", recording.platform);
        }
        println!(
            "{}: {} lines in {}, columns explained in {}",
            recording.platform,
            exported.rows,
            exported.csv.display(),
            exported.map.display()
        );
    }
    Ok(())
}

fn topics(arguments: &CsvArguments) -> anyhow::Result<()> {
    let bag = RunDirectory::open(&arguments.run)?.bag()?;
    let exported = whorl_bag::export_csv(&bag, &arguments.out)?;
    if exported.is_empty() {
        bail!("{} has no topics", arguments.run.display());
    }
    for topic in exported {
        match topic.file {
            Some(file) => println!("{}: {} lines in {}", topic.topic, topic.rows, file.display()),
            None => println!("{}: left out, the type of its messages is not known", topic.topic),
        }
    }
    Ok(())
}
