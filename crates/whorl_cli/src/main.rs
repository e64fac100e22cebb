//! The `whorl` command.

#![allow(
    rustdoc::broken_intra_doc_links,
    rustdoc::invalid_html_tags,
    reason = "doc comments of arguments are the text of --help, with units in brackets and <PLACEHOLDERS>"
)]

mod command;
mod monitor;
mod report;
mod simulate;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Formation coordination for spherical air-bearing platforms.
#[derive(Debug, Parser)]
#[command(name = "whorl", version, about, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Runs an experiment in one process, much faster than real time, and records it.
    Simulate(simulate::Arguments),
    /// Starts the experiment that the coordinator was loaded with.
    Start {
        /// Its name as a check; left out: whichever is loaded.
        #[arg(default_value = "")]
        experiment: String,
    },
    /// Ends the running experiment: every platform goes to its safe mode.
    Abort {
        /// For the log.
        #[arg(default_value = "")]
        reason: String,
    },
    /// Shows phase, attitudes, errors, links and gas of a running formation; ends with the experiment.
    Monitor(monitor::Arguments),
    /// Writes report.html and summary.json of recorded runs, and prints the headline numbers.
    Report {
        /// Run directories or rosbag2 directories.
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Where the page goes; with one RUN only [default: RUN/report.html].
        #[arg(long, value_name = "FILE")]
        html: Option<PathBuf>,
    },
}

fn main() -> ExitCode {
    // `whorl ... | head` ends quietly when nobody reads on, as every filter does.
    let _ = signal_hook::flag::register_conditional_shutdown(
        signal_hook::consts::SIGPIPE,
        0,
        std::sync::Arc::new(std::sync::atomic::AtomicBool::new(true)),
    );
    let result = match Arguments::parse().command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Start { experiment } => command::start(experiment),
        Command::Abort { reason } => command::abort(reason),
        Command::Monitor(arguments) => monitor::run(&arguments),
        Command::Report { runs, html } => report::run(&runs, html.as_deref()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
