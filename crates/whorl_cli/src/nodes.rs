//! `whorl nodes`: single nodes on this machine, for platforms with a computer of their own.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Subcommand};
use whorl_launch::{Backend, DriverSource, Programs, Setup, Supervisor, become_node};
use whorl_node::{Node, Place};

use crate::output::say;
use crate::run::{
    Folders, Interrupted, Names, Scheduling, exit_code, names, stop, this_domain, use_emulators, watch,
};

#[derive(Debug, Subcommand)]
pub enum Command {
    /// The node set of one platform: driver, estimator, local control, model monitor. Ctrl-C stops it.
    Platform(Platform),
    /// The coordinator: experiment sequence, relative-attitude law, authority heartbeat.
    Coordinator(Coordinator),
    /// The recorder: every topic into a run directory.
    Recorder(Recorder),
    /// Stops all nodes on this machine in this ROS domain (ROS_DOMAIN_ID).
    Stop,
    /// Lists all nodes.
    List,
}

#[derive(Debug, Args)]
pub struct Platform {
    /// Name of the platform, which is the namespace of its nodes: whorl_1, whorl_2, ...
    platform: String,
    /// Backend of the driver: sim, replay or hardware.
    #[arg(long, value_name = "KIND", default_value = "sim", value_parser = str::parse::<Backend>)]
    backend: Backend,
    /// Recording for --backend replay: run directory, bag or CSV.
    #[arg(long, value_name = "FILE")]
    source: Option<PathBuf>,
    /// Map of the columns of a CSV recording, such as params/channels/broad.yaml.
    #[arg(long, value_name = "FILE")]
    channels: Option<PathBuf>,
    /// Seed of the simulated hardware.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    scheduling: Scheduling,
    #[command(flatten)]
    parameters: Parameters,
}

#[derive(Debug, Args)]
pub struct Coordinator {
    /// Platforms, e.g. "whorl_1 whorl_2" [default: those of the parameter files].
    #[arg(long, value_name = "\"A B\"", value_parser = names)]
    platforms: Option<Names>,
    /// Wait for the service /coordinator/start (`whorl start`).
    #[arg(long)]
    no_auto_start: bool,
    #[command(flatten)]
    parameters: Parameters,
}

#[derive(Debug, Args)]
pub struct Recorder {
    /// Platforms, e.g. "whorl_1 whorl_2" [default: those of the parameter files].
    #[arg(long, value_name = "\"A B\"", value_parser = names)]
    platforms: Option<Names>,
    /// Folder of run directories [default: runs/].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    parameters: Parameters,
}

/// Where the parameters come from.
#[derive(Debug, Args)]
pub struct Parameters {
    /// Experiment: a name in params/experiments/, or a file.
    #[arg(long, value_name = "NAME|FILE", default_value = "leader_follower")]
    experiment: String,
    #[command(flatten)]
    folders: Folders,
}

impl Parameters {
    fn setup(&self, platforms: Option<&Names>) -> anyhow::Result<Setup> {
        let mut options = self.folders.options(&self.experiment);
        options.platforms = platforms.map(|Names(names)| names.clone());
        Ok(Setup::new(options)?)
    }
}

/// Carries out `whorl nodes`. The exit status is that of `whorl run`.
pub fn run(command: &Command) -> ExitCode {
    exit_code(match command {
        Command::Platform(arguments) => platform(arguments),
        Command::Coordinator(arguments) => coordinator(arguments),
        Command::Recorder(arguments) => recorder(arguments),
        Command::Stop => stop_all(),
        Command::List => list(),
    })
}

fn platform(arguments: &Platform) -> anyhow::Result<u8> {
    let Platform { platform, backend, source, channels, seed, scheduling, parameters } = arguments;
    let real_time = scheduling.real_time()?;
    let mut options = parameters.folders.options(&parameters.experiment);
    options.platforms = Some(vec![platform.clone()]);
    options.seed = *seed;
    let driver = DriverSource {
        backend: *backend,
        source: source.clone(),
        channels: channels.clone(),
        emulated: None,
    };
    options.drivers.insert(platform.clone(), driver);
    let mut setup = Setup::new(options)?;
    let (domain, programs) = (this_domain()?, Programs::beside_this_one()?);
    use_emulators(&mut setup, &domain);
    for process in setup.platform(platform) {
        programs.path(process.node)?;
    }
    let _lease = domain.share(platform)?;
    let interrupted = Interrupted::new()?;
    domain.remember_supervisor(platform);
    let mut supervisor = Supervisor::new(domain.clone()).with_real_time(real_time);
    for process in setup.platform(platform) {
        supervisor.start(&programs, process, &domain.logs())?;
    }
    say!("{platform} is up (logs in {}); Ctrl-C stops it", domain.logs().display());
    let status = watch(&mut supervisor, None, None, &interrupted);
    let all_well = stop(&mut supervisor);
    domain.forget_supervisor(platform);
    Ok(if status == 0 && !all_well { 1 } else { status })
}

fn coordinator(arguments: &Coordinator) -> anyhow::Result<u8> {
    let setup = arguments.parameters.setup(arguments.platforms.as_ref())?;
    let waiting = [("experiment.auto_start", "false")];
    let process = setup.coordinator(if arguments.no_auto_start { &waiting } else { &[] });
    let (domain, programs) = (this_domain()?, Programs::beside_this_one()?);
    let _lease = domain.share(&process.label)?;
    domain.remember_self(&process.label);
    match become_node(&programs, process)? {}
}

fn recorder(arguments: &Recorder) -> anyhow::Result<u8> {
    let setup = arguments.parameters.setup(arguments.platforms.as_ref())?;
    let (domain, programs) = (this_domain()?, Programs::beside_this_one()?);
    programs.path(Node::Recorder)?;
    let _lease = domain.share(Node::Recorder.name())?;
    let run = arguments.parameters.folders.new_run(arguments.out.as_deref(), &setup)?;
    let process = setup.recorder(&run, None, None);
    domain.remember_self(&process.label);
    match become_node(&programs, process)? {}
}

fn stop_all() -> anyhow::Result<u8> {
    let (domain, id) = (this_domain()?, whorl_ros::environment::Network::from_environment()?.domain_id);
    let (nodes, screens) = domain.stop();
    let and = if screens > 0 { format!(" and {screens} pages and screens") } else { String::new() };
    say!("stopped {nodes} nodes{and} in domain {id}");
    Ok(0)
}

fn list() -> anyhow::Result<u8> {
    for info in Node::ALL.iter().map(|node| node.info()).filter(|info| info.is_program) {
        let place = match info.place {
            Place::Platform => "each platform",
            Place::Formation => "once",
            Place::Either => "once, or each platform",
        };
        say!("{:14} {place:23} {}", info.name, info.purpose);
    }
    Ok(0)
}
