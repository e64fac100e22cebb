//! `whorl emulators`: devices that are not there, for drivers with backend hardware.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use whorl_devices::emulation::{Emulation, EmulationError, Setup as Emulated};
use whorl_driver::messages::truth_message;
use whorl_driver::{Backend, Parameters, parameters};
use whorl_launch::Setup;
use whorl_msgs::topics::{Message, Topic};
use whorl_node::Timestamp;
use whorl_params::{Override, ParameterTree};
use whorl_ros::environment::Network;
use whorl_ros::{AmbientNetwork, EndpointQos, Participant, RawWriter};

use crate::output::{say, tell};
use crate::run::{Folders, Interrupted, exit_code, this_domain};

#[derive(Debug, Args)]
pub struct Arguments {
    /// Platforms whose devices are emulated: whorl_1, whorl_2, ...
    #[arg(required = true, value_name = "PLATFORM")]
    platforms: Vec<String>,
    /// Experiment whose initial motion the platforms have: a name in params/experiments/, or a file.
    #[arg(long, value_name = "NAME|FILE", default_value = "leader_follower")]
    experiment: String,
    /// Seed of the sensors' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Parameter of the drivers' sections, such as -p emulation.faults.a.kind:=unplugged; may be repeated.
    #[arg(short, long = "param", value_name = "KEY:=VALUE")]
    parameters: Vec<String>,
    #[command(flatten)]
    folders: Folders,
}

/// Carries out `whorl emulators`. Ctrl-C ends it; the exit status is then 0.
pub fn run(arguments: &Arguments) -> ExitCode {
    exit_code(try_run(arguments))
}

fn try_run(arguments: &Arguments) -> anyhow::Result<u8> {
    let mut options = arguments.folders.options(&arguments.experiment);
    options.platforms = Some(arguments.platforms.clone());
    let setup = Setup::new(options)?;
    let all: Vec<Parameters> = arguments
        .platforms
        .iter()
        .map(|platform| driver_parameters(arguments, &setup, platform))
        .collect::<Result<_, _>>()?;
    let domain = this_domain()?;
    let interrupted = Interrupted::new()?;
    let participant = Participant::new(&Network::from_environment()?)?;
    let stop = Arc::new(AtomicBool::new(false));
    let mut running = Vec::new();
    for parameters in all {
        let name = parameters.name.clone();
        let (root, lock) = domain.take_emulation(&name)?;
        let emulation = emulation(parameters, root.clone())?;
        let info = Topic::TruthState.info();
        let topic = format!("/{name}/{}", info.name);
        let writer = participant.writer(&topic, info.message_type.name(), EndpointQos::from(info.qos))?;
        say!("{name}: devices are emulated below {}", root.display());
        running.push((name, lock, start(emulation, writer, Arc::clone(&stop))?));
    }
    domain.remember_supervisor(LABEL);
    say!("drivers with --backend hardware in this ROS domain find them; Ctrl-C ends them");
    while !interrupted.yes() && !running.iter().any(|(.., thread)| thread.is_finished()) {
        std::thread::sleep(Duration::from_millis(100));
    }
    stop.store(true, Ordering::Relaxed);
    let mut status = 0;
    for (name, _lock, thread) in running {
        match thread.join() {
            Ok((emulation, Ok(()))) => summarise(&name, &emulation),
            Ok((_, Err(error))) => {
                tell(format_args!("error: {name}: {error}"));
                status = 1;
            }
            Err(_) => bail!("{name}: the emulation ended by a fault of its own"),
        }
    }
    domain.forget_supervisor(LABEL);
    Ok(status)
}

const LABEL: &str = "emulators";

/// What the driver of a platform would read.
fn driver_parameters(arguments: &Arguments, setup: &Setup, platform: &str) -> anyhow::Result<Parameters> {
    let seed = format!("seed:={}", arguments.seed);
    let texts = arguments.parameters.iter().chain([&seed]);
    let overrides = texts.map(|text| Override::parse(text)).collect::<Result<Vec<_>, _>>()?;
    let tree = ParameterTree::load(&setup.driver_files(platform), &overrides)?;
    let own = tree.for_node(&format!("/{platform}/driver"));
    let (parameters, _) = whorl_params::try_read(&own, parameters::read)?;
    if !parameters.devices.missing.is_empty() {
        bail!("{platform} has no device for: {} (docs/hardware.md)", parameters.devices.missing.join(", "));
    }
    Ok(parameters)
}

fn emulation(parameters: Parameters, root: std::path::PathBuf) -> anyhow::Result<Emulation> {
    let Backend::Simulated { truth, start, seed, .. } = parameters.backend else {
        bail!("{}: the driver's section sets a backend; allowed: none", parameters.name);
    };
    let start = start.at(whorl_ros::wall_clock());
    let (devices, faults) = (parameters.devices, parameters.emulated_faults);
    Ok(Emulation::new(Emulated {
        devices,
        truth: *truth,
        start,
        seed,
        faults,
        root,
        network: Some(Arc::new(AmbientNetwork)),
    })?)
}

type Ended = (Emulation, Result<(), EmulationError>);

fn start(
    mut emulation: Emulation,
    writer: RawWriter,
    stop: Arc<AtomicBool>,
) -> anyhow::Result<JoinHandle<Ended>> {
    let thread = std::thread::Builder::new().name("emulators".to_owned());
    let run = move || {
        let (mut sequence, mut bytes) = (0, Vec::new());
        let result = emulation.run(&stop, |now_ns, truth| {
            let message = Message::from(truth_message(&truth.motion(), Timestamp(now_ns), sequence));
            sequence += 1;
            // A sample that is lost is one of a hundred a second.
            if message.encode_into(&mut bytes).is_ok() {
                let _ = writer.publish(&bytes);
            }
        });
        (emulation, result)
    };
    thread.spawn(run).context("cannot start a thread")
}

fn summarise(name: &str, emulation: &Emulation) {
    if let Some((median_s, p99_s, count)) = emulation.latency_s() {
        say!(
            "{name}: from a sample of the inertial sensor to the wheels' torque, on the devices' wires: median {:.2} ms, 99 % \
             below {:.2} ms ({count} samples)",
            median_s * 1e3,
            p99_s * 1e3
        );
    }
    if emulation.late() > 0 {
        tell(format_args!(
            "warning: {name}: this computer had no time for the emulators {} times",
            emulation.late()
        ));
    }
}
