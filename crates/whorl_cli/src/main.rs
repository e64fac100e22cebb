//! The `whorl` command.

#![deny(clippy::print_stdout, clippy::print_stderr)]
#![allow(
    rustdoc::broken_intra_doc_links,
    rustdoc::invalid_html_tags,
    reason = "doc comments of arguments are the text of --help, with units in brackets and <PLACEHOLDERS>"
)]

mod adopt;
mod arm;
mod balance;
mod calibrate;
mod campaign;
mod checkout;
mod command;
mod compare;
mod compare_runs;
mod demo;
mod diagnose;
mod discover;
mod doctor;
mod effects;
mod emulators;
mod estimate;
mod examples;
mod excitation;
mod explain;
mod export;
mod history;
mod identify;
mod import;
mod index;
mod init;
mod live;
mod model_file;
mod monitor;
mod new;
mod next;
mod nodes;
mod open;
mod orbit;
mod output;
mod parameters;
mod platforms;
mod progress;
mod provenance;
mod report;
mod reproduce;
mod run;
mod runs;
mod security;
mod shell;
mod simulate;
mod subscription;
mod table;
mod where_;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use whorl_math::words::one_line;

/// Runs, simulates and records spherical air-bearing platforms in formation, and explains why a rig does not do what its
/// model says.
#[derive(Debug, Parser)]
#[command(name = "whorl", version, about, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Writes the parameter files (platforms, experiments, campaigns) that the other commands start from; a checkout has them.
    Init(init::Arguments),
    /// Looks at a CSV file or a bag and writes the platform's file and the map of channels that the other commands need; each
    /// line says where its number is from.
    New(new::Arguments),
    /// Runs an experiment over DDS on this machine, from start to report, with a process for every node.
    Run(run::Arguments),
    /// Starts and stops single parts on this machine: the nodes of a platform, the coordinator, the recorder.
    #[command(subcommand)]
    Nodes(nodes::Command),
    /// Emulates the devices of platforms, over their own protocols, for drivers with --backend hardware.
    Emulators(emulators::Arguments),
    /// Lets platforms move, once their devices answer. Simulated and emulated ones are armed by themselves.
    Arm(arm::Arguments),
    /// Closes all valves and switches the motors of platforms off, until they are armed again.
    Disarm(arm::Arguments),
    /// Whether this computer is fit to carry a platform: clock, network, devices, disk, heat, load; what to do where it is not.
    Doctor(doctor::Arguments),
    /// Works each wheel and jet of a platform for a moment and compares what it does with the model: wires and signs that are
    /// exchanged.
    Checkout(checkout::Arguments),
    /// Runs an experiment in one process, much faster than real time, and records it.
    Simulate(simulate::Arguments),
    /// Simulates many runs over parameters, seeds, faults and links; resumes an interrupted campaign.
    Campaign(campaign::Arguments),
    /// Checks the orbits of an experiment and shows where its platforms have to point.
    Orbit(orbit::Arguments),
    /// Writes a parameter folder for any number of platforms.
    Platforms(platforms::Arguments),
    /// Estimates attitude from the recording of a gyro with an accelerometer, a magnetometer or other direction sensors.
    Estimate(estimate::Arguments),
    /// Starts the experiment that the coordinator has loaded, or goes on with one that is held.
    Start {
        /// Name of the experiment, as a check [default: whichever is loaded].
        #[arg(default_value = "", hide_default_value = true)]
        experiment: String,
    },
    /// Holds the running experiment: references come to rest, and the sequence waits for `whorl start`.
    Hold {
        /// Reason, for the log.
        #[arg(default_value = "", hide_default_value = true)]
        reason: String,
    },
    /// Ends the running experiment: every platform goes to its safe mode.
    Abort {
        /// Reason, for the log.
        #[arg(default_value = "", hide_default_value = true)]
        reason: String,
    },
    /// Shows phase, attitudes, errors, links and gas of a running formation; ends with the experiment.
    Monitor(monitor::Arguments),
    /// Shows a running formation in a browser: in 3-D, with its errors, links, modes and faults; starts, holds and aborts it.
    Live(live::Arguments),
    /// Writes report.html and summary.json of recorded runs, and prints the headline numbers.
    Report {
        /// Run directories or rosbag2 directories.
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Path of the HTML page; with one RUN only [default: RUN/report.html].
        #[arg(long, value_name = "FILE")]
        html: Option<PathBuf>,
        #[command(flatten)]
        json: output::JsonArgument,
    },
    /// Lists runs: experiment, law, seed, verdict, errors, effects of the models; sorts, filters, and makes a page of them.
    Runs(index::Arguments),
    /// What differs between two runs or more: parameters, and results beyond noise; a page with all in every plot.
    CompareRuns(compare_runs::Arguments),
    /// Imports measurements of another system (CSV, or a bag with other topics) as a run directory.
    Import(import::Arguments),
    /// Writes the measurements of runs as CSV or Parquet.
    Export(export::Arguments),
    /// Opens recordings in a browser: look at them, compare them with a model, find the effect that it lacks, adopt it, take it back.
    Open(open::Arguments),
    /// How far off the model is: prediction errors by channel and horizon, relative to the noise.
    Compare(compare::Arguments),
    /// Where the model fails: the quantities that the unexplained torque depends on.
    Where(where_::Arguments),
    /// Which physical effect the model lacks: a verdict in words, then every effect tested.
    Diagnose(diagnose::Arguments),
    /// Which law is missing where no effect of the catalogue explains the data; writes it as an effect.
    Discover(discover::Arguments),
    /// Adds physical effects to a platform's model, refits it and shows the errors before and after.
    Adopt(adopt::Arguments),
    /// What was adopted into a platform's model, when, and how much it improved the predictions.
    History(history::Arguments),
    /// Writes the manoeuvre that best separates the remaining explanations as an experiment.
    Next(next::Arguments),
    /// Lists and explains the physical effects that can be simulated, fitted and compensated.
    Effects(effects::Arguments),
    /// Lists every parameter of every node: default, range and meaning.
    Parameters(parameters::Arguments),
    /// Identifies mass properties from runs, with uncertainties, and reports insufficient excitation.
    Identify(identify::Arguments),
    /// Predicts how well an experiment will determine the mass properties.
    Excitation(excitation::Arguments),
    /// Computes how far to move which balance mass, from runs in which the platform swung freely.
    Balance(balance::Arguments),
    /// Calibrates sensors from recordings and writes the result into the platform's file.
    Calibrate(calibrate::Arguments),
    /// Makes, lists and checks keystores (SROS2): keys, certificates and permissions of the nodes.
    #[command(subcommand)]
    Security(security::Command),
    /// Shows in two minutes what Whorl does: hides an effect in a simulated platform that its model does not have, finds it,
    /// adopts it, and tells the secret.
    ///
    /// An experiment, how far off the model is, where, which effect is missing, adopting it, and the same experiment with the
    /// new model. Prints both errors before and after.
    Demo(demo::Arguments),
    /// Recomputes figures and tables of the dissertation and compares them with the printed values.
    Reproduce(reproduce::Arguments),
    /// Prints the completions of a shell, e.g. `source <(whorl completions bash)`.
    Completions {
        /// Which shell.
        shell: clap_complete::Shell,
    },
    /// Writes manual pages: one for whorl and one for each command.
    Man {
        /// Folder to write them into.
        #[arg(value_name = "FOLDER")]
        folder: PathBuf,
    },
}

/// The command line with the examples of every command.
fn command_line() -> clap::Command {
    examples::with_examples(Arguments::command())
}

fn main() -> ExitCode {
    let matches = command_line().get_matches();
    // Names of files are among them, and what prints one would print several lines of somebody else's.
    if let Some(argument) = std::env::args_os().find(|argument| argument.as_encoded_bytes().contains(&b'\n'))
    {
        let shown = argument.display().to_string();
        let what = "has an end of line in it; allowed: one line. A file of that name can be renamed";
        output::tell(format_args!("error: `{}` {what}", one_line(&shown)));
        return ExitCode::FAILURE;
    }
    output::reserve(&matches);
    let command = match Arguments::from_arg_matches(&matches) {
        Ok(Arguments { command }) => command,
        Err(error) => error.exit(),
    };
    // The standard library ignores SIGPIPE: `whorl ... | head` ends when its work is done, and its files are written.
    let status = carried_out(command);
    match output::failure() {
        Some(failure) => {
            output::tell(format_args!("error: {failure}"));
            ExitCode::FAILURE
        }
        None => status,
    }
}

fn carried_out(command: Command) -> ExitCode {
    let result = match command {
        Command::Run(arguments) => return run::run(&arguments),
        Command::Emulators(arguments) => return emulators::run(&arguments),
        Command::Checkout(arguments) => return checkout::run(&arguments),
        Command::Doctor(arguments) => return doctor::run(&arguments),
        Command::Nodes(command) => return nodes::run(&command),
        Command::Demo(arguments) => return demo::run(&arguments),
        Command::Init(arguments) => init::run(&arguments),
        Command::New(arguments) => new::run(&arguments),
        Command::Arm(arguments) => arm::run(&arguments, true),
        Command::Disarm(arguments) => arm::run(&arguments, false),
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Estimate(arguments) => estimate::run(&arguments),
        Command::Campaign(arguments) => campaign::run(&arguments),
        Command::Orbit(arguments) => orbit::run(&arguments),
        Command::Platforms(arguments) => platforms::run(&arguments),
        Command::Start { experiment } => command::start(experiment),
        Command::Hold { reason } => command::hold(reason),
        Command::Abort { reason } => command::abort(reason),
        Command::Live(arguments) => live::run(&arguments),
        Command::Monitor(arguments) => monitor::run(&arguments),
        Command::Report { runs, html, json } => report::run(&runs, html.as_deref(), &json),
        Command::Import(arguments) => import::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Open(arguments) => open::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Where(arguments) => where_::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Discover(arguments) => discover::run(&arguments),
        Command::Adopt(arguments) => adopt::run(&arguments),
        Command::History(arguments) => history::run(&arguments),
        Command::Next(arguments) => next::run(&arguments),
        Command::Effects(arguments) => effects::run(&arguments),
        Command::Parameters(arguments) => parameters::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Excitation(arguments) => excitation::run(&arguments),
        Command::Balance(arguments) => balance::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Security(command) => security::run(&command),
        Command::Reproduce(arguments) => reproduce::run(&arguments),
        Command::CompareRuns(arguments) => compare_runs::run(&arguments),
        Command::Runs(arguments) => index::run(&arguments),
        Command::Completions { shell } => {
            shell::completions(shell);
            Ok(())
        }
        Command::Man { folder } => shell::man(&folder),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::tell(format_args!("error: {}", whorl_commands::in_words(&error)));
            ExitCode::FAILURE
        }
    }
}
