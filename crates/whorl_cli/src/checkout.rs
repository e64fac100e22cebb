//! `whorl checkout`: works each wheel and each jet for a moment, and compares what the platform does with the model.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use clap::Args;
use nalgebra::Vector3;
use serde_json::json;
use whorl_devices::checkout::{Finding, Part, Trial};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_launch::{Backend, DriverSource, Programs, Setup, Supervisor};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::ActuatorCommand;
use whorl_node::{Node, Timestamp};
use whorl_params::ParameterTree;
use whorl_ros::environment::Network;
use whorl_ros::{EndpointQos, Participant, RawWriter};

use crate::arm;
use crate::output::{say, tell};
use crate::run::{AboutPlatform, Interrupted, exit_code, stop, this_domain, use_emulators};
use crate::subscription::Subscription;

mod trial;

use trial::{Attempts, Checked, Mean, Since, Tried, damping};

/// Torque of a wheel, as a share of what it can do, and for how long.
const WHEEL_SHARE: f64 = 0.6;
const WHEEL_S: f64 = 0.5;
/// Rate of a gimbal, as a share of what it can do, and for how long.
const GIMBAL_SHARE: f64 = 0.4;
const GIMBAL_S: f64 = 0.5;
/// On-time of a jet.
const JET_S: f64 = 0.4;
/// Rates are means over this; after a pulse, behind valves and filters.
const WINDOW_S: f64 = 0.25;
const SETTLES_S: f64 = 0.05;
/// Samples of which a mean is made.
const FEWEST: usize = 5;
/// Between pulses of jets, in which the wheels bring the platform to rest.
const REST_S: f64 = 1.5;
const COMMANDS: Duration = Duration::from_millis(10);
/// What is listened to.
const MEASURED: [Topic; 4] = [Topic::ImuRaw, Topic::WheelState, Topic::GimbalState, Topic::ThrusterState];
const STARTUP: Duration = Duration::from_secs(20);
/// A part that worked for less than this share of what it was told was not tried; one that worked for more than the second share is
/// not believed.
const SHORTEST: f64 = 0.5;
const LONGEST: f64 = 4.0;
/// Samples that are so many times as far apart as usual were read late.
const GAP: f64 = 3.0;
/// Samples may come so late.
const LATE: Duration = Duration::from_secs(3);
/// A platform that turns faster is left alone [rad/s].
const FASTEST_RAD_S: f64 = 0.15;

#[derive(Debug, Args)]
pub struct Arguments {
    /// Platform, whose nodes must not run.
    platform: String,
    /// What the driver drives: hardware or sim.
    #[arg(long, value_name = "KIND", default_value = "hardware", value_parser = str::parse::<Backend>)]
    backend: Backend,
    /// The platform floats and nobody is in its way: real devices are armed without asking.
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    about: AboutPlatform,
}

/// Carries out `whorl checkout`. The exit status is 0 when everything is as the model says, 1 when something is not.
pub fn run(arguments: &Arguments) -> ExitCode {
    exit_code(try_run(arguments))
}

fn try_run(arguments: &Arguments) -> anyhow::Result<u8> {
    let platform = &arguments.platform;
    let mut options = arguments.about.options();
    options.platforms = Some(vec![platform.clone()]);
    let driver = DriverSource { backend: arguments.backend, ..DriverSource::default() };
    options.drivers.insert(platform.clone(), driver);
    let mut setup = Setup::new(options)?;
    let (domain, programs) = (this_domain()?, Programs::beside_this_one()?);
    use_emulators(&mut setup, &domain);
    let (model, prior) = model(&setup, platform)?;
    let driver = setup.platform(platform).into_iter().find(|process| process.node == Node::Driver);
    let driver = driver.context("a platform has a driver")?;
    let _lease = domain.share(platform)?;
    let interrupted = Interrupted::new()?;
    let mut supervisor = Supervisor::new(domain.clone());
    supervisor.start(&programs, driver, &domain.logs())?;
    let result = Bench::new(platform, &model, &interrupted).and_then(|mut bench| {
        bench.wait_for_devices(&mut supervisor)?;
        if arguments.backend == Backend::Hardware && domain.emulated(platform).is_none() {
            if !arguments.yes {
                bail!("this moves the platform: let it float, keep clear, and say so with --yes");
            }
            arm::set(std::slice::from_ref(platform), true)?;
        }
        bench.check(&model, &prior)
    });
    let all_well = stop(&mut supervisor);
    let parts = result?;
    let wrong = parts.iter().filter(|part| !part.is_right).count();
    arguments
        .about
        .json
        .write(|| Ok(json!({"schema": 1, "platform": platform, "wrong": wrong, "parts": parts})))?;
    say!(
        "{}",
        match wrong {
            0 => format!("{platform}: every actuator does what the model says, within its priors"),
            1 => format!("{platform}: one actuator does not do what the model says"),
            _ => format!("{platform}: {wrong} actuators do not do what the model says"),
        }
    );
    Ok(u8::from(wrong > 0 || !all_well))
}

fn model(setup: &Setup, platform: &str) -> anyhow::Result<(PlatformModel, ModelPrior)> {
    let tree = ParameterTree::load(&setup.driver_files(platform), &[])?;
    let own = tree.for_node(&format!("/{platform}/driver"));
    let model = whorl_params::try_read(&own, whorl_driver::parameters::read)?.0.model;
    let known = whorl_params::read_shared(&own, whorl_params::platform_model_with_prior)?;
    let prior = known.map_or_else(|| ModelPrior::typical(&model), |(_, known)| known.prior);
    Ok((model, prior))
}

/// A driver, its sensors and its actuators.
struct Bench<'a> {
    topics: Subscription,
    _participant: Participant,
    writer: RawWriter,
    interrupted: &'a Interrupted,
    sequence: u64,
    slot: u64,
    /// By the time of each sample, which a busy computer does not move.
    rates: Vec<(Timestamp, Vector3<f64>)>,
    /// Torques of the wheels' motors, and when.
    efforts: Vec<(Timestamp, Vec<f64>)>,
    /// On-time of each jet's valve in all \[s\].
    on_time_s: Vec<f64>,
    seen: bool,
    /// Of the platform's gimbals: angles measured last \[rad\], empty before; what they are told [rad/s].
    gimbal_angle_rad: Vec<f64>,
    gimbal_rate_rad_s: Vec<f64>,
}

impl<'a> Bench<'a> {
    fn new(platform: &str, model: &PlatformModel, interrupted: &'a Interrupted) -> anyhow::Result<Self> {
        let network = Network::from_environment()?;
        let platforms = [platform.to_owned()];
        let topics = Subscription::new(&network, &platforms, &[], &MEASURED)?;
        let route = Route::platform(PlatformId(0), Topic::ActuatorCommand);
        let name = route.name(&platforms).context("the platform's topics")?;
        let info = route.topic.info();
        let (participant, writer) = Participant::with(&network, |participant| {
            participant.writer(&name, info.message_type.name(), EndpointQos::from(info.qos))
        })?;
        Ok(Self {
            topics,
            _participant: participant,
            writer,
            interrupted,
            sequence: 0,
            slot: 0,
            rates: Vec::new(),
            efforts: Vec::new(),
            on_time_s: Vec::new(),
            seen: false,
            gimbal_angle_rad: Vec::new(),
            gimbal_rate_rad_s: vec![0.0; model.gyros().len()],
        })
    }

    fn wait_for_devices(&mut self, supervisor: &mut Supervisor) -> anyhow::Result<()> {
        let until = Instant::now() + STARTUP;
        while !self.seen || self.rates.len() < 20 {
            self.look()?;
            if let Some(ended) = supervisor.ended() {
                bail!("the driver ended:\n{}", ended.last_words());
            }
            if Instant::now() > until {
                bail!("no rates and no wheel speeds within {} s: {}", STARTUP.as_secs(), self.topics.hint());
            }
            std::thread::sleep(COMMANDS);
        }
        Ok(())
    }

    fn look(&mut self) -> anyhow::Result<()> {
        if self.interrupted.yes() {
            bail!("interrupted");
        }
        let Self { topics, rates, efforts, on_time_s, gimbal_angle_rad, seen, .. } = self;
        topics.drain(|route, message| match message {
            Message::Imu(Imu { header, angular_velocity, .. }) => {
                rates.push((header.stamp.into(), angular_velocity.into()));
            }
            Message::JointState(state) if route.topic == Topic::GimbalState => {
                *seen = true;
                *gimbal_angle_rad = state.position;
            }
            Message::JointState(state) => {
                *seen = true;
                efforts.push((state.header.stamp.into(), state.effort));
            }
            Message::ThrusterState(state) => *on_time_s = state.total_on_time_s,
            _ => {}
        })
    }

    /// Commands these torques, and jets as of the current slot, for so long; `wheels` may depend on the latest rate.
    fn command(
        &mut self,
        length_s: f64,
        jets: &[f64],
        wheels: impl Fn(&Vector3<f64>) -> Vec<f64>,
    ) -> anyhow::Result<()> {
        self.slot += 1;
        let until = Instant::now() + Duration::from_secs_f64(length_s);
        let mut bytes = Vec::new();
        while Instant::now() < until {
            self.look()?;
            let rate = self.rates.last().map_or_else(Vector3::zeros, |(_, rate)| *rate);
            if rate.norm() > FASTEST_RAD_S {
                bail!(
                    "the platform turns with {:.1} deg/s: bring it to rest first",
                    rate.norm().to_degrees()
                );
            }
            let now = whorl_ros::wall_clock();
            let command = ActuatorCommand {
                header: Header { stamp: now.into(), frame_id: String::new() },
                sequence: self.sequence,
                valid_until: (now + Duration::from_secs(1)).into(),
                wheel_torque_n_m: wheels(&rate),
                jet_slot: self.slot,
                jet_slot_length_s: length_s.max(JET_S),
                jet_on_time_s: jets.to_vec(),
                gimbal_rate_rad_s: self.gimbal_rate_rad_s.clone(),
            };
            self.sequence += 1;
            Message::from(command).encode_into(&mut bytes)?;
            self.writer.publish(&bytes)?;
            std::thread::sleep(COMMANDS.min(until.saturating_duration_since(Instant::now())));
        }
        Ok(())
    }

    /// The next commands turn this gimbal \[rad/s\].
    fn turn_gimbal(&mut self, index: usize, rate_rad_s: f64) {
        self.gimbal_rate_rad_s.iter_mut().skip(index).take(1).for_each(|rate| *rate = rate_rad_s);
    }

    /// Rate over the window that ends now, once its samples have come; over the next one where a busy computer took none.
    fn rate(&mut self) -> anyhow::Result<Mean> {
        let late = Instant::now() + LATE;
        let (end, window) = loop {
            let end = whorl_ros::wall_clock();
            while self.rates.last().is_none_or(|(at, _)| *at < end) && Instant::now() < late {
                self.look()?;
                std::thread::sleep(COMMANDS);
            }
            let in_window = |at: Timestamp| (0.0..=WINDOW_S).contains(&end.seconds_since(at));
            let within = self.rates.iter().filter(|(at, _)| in_window(*at));
            let window: Vec<(f64, Vector3<f64>)> =
                within.map(|(at, rate)| (at.seconds_since(end), *rate)).collect();
            if window.len() >= FEWEST {
                break (end, window);
            }
            if Instant::now() > late {
                bail!("{} samples of the gyro in {WINDOW_S} s: is it connected?", window.len());
            }
            std::thread::sleep(COMMANDS);
        };
        let count = window.len() as f64;
        let mean = window.iter().map(|(_, rate)| rate).sum::<Vector3<f64>>() / count;
        let spread = window.iter().map(|(_, rate)| (rate - mean).norm_squared());
        let variance = spread.sum::<f64>() / (3.0 * (count - 1.0));
        let age_s = window.iter().map(|(age_s, _)| age_s).sum::<f64>() / count;
        Ok(Mean { rate: mean, noise: (variance / count).sqrt(), end, age_s })
    }

    /// For how long a part really worked between two instants, by what its driver says \[s\]: a busy computer is late to end it.
    fn worked_s(&self, part: Part, command: f64, since: &Since, until: Timestamp) -> f64 {
        match part {
            Part::Wheel(index) => {
                let during = self.efforts.iter().filter(|(at, _)| *at >= since.at && *at <= until);
                let during: Vec<(Timestamp, f64)> =
                    during.map(|(at, efforts)| (*at, efforts.get(index).copied().unwrap_or(0.0))).collect();
                let pairs = during.iter().zip(during.iter().skip(1));
                let impulse = pairs.map(|(a, b)| b.0.seconds_since(a.0) * 0.5 * (a.1 + b.1)).sum::<f64>();
                (impulse / command).abs()
            }
            Part::Jet(index) => {
                let total = |all: &[f64]| all.get(index).copied().unwrap_or(0.0);
                total(&self.on_time_s) - total(&since.on_time_s)
            }
            Part::Gyro(index) => {
                let angle = |all: &[f64]| all.get(index).copied().unwrap_or(0.0);
                ((angle(&self.gimbal_angle_rad) - angle(&since.gimbal_angle_rad)) / command).abs()
            }
        }
    }

    /// Whether samples of the gyro came steadily in a time span.
    fn steady(&self, from: Timestamp, until: Timestamp) -> bool {
        let within = self.rates.iter().map(|(at, _)| *at).filter(|at| *at >= from && *at <= until);
        let within: Vec<Timestamp> = within.collect();
        let gaps = within.iter().zip(within.iter().skip(1)).map(|(a, b)| b.seconds_since(*a));
        let usual_s = until.seconds_since(from) / within.len() as f64;
        gaps.fold(0.0, f64::max) <= SETTLES_S.max(GAP * usual_s)
    }

    /// Works a part once.
    fn try_once(
        &mut self,
        part: Part,
        command: f64,
        length_s: f64,
        model: &PlatformModel,
    ) -> anyhow::Result<Tried> {
        let (no_jets, no_wheels) = (vec![0.0; model.jets().len()], vec![0.0; model.wheels().len()]);
        // Nothing of what brought it back may be in the first mean.
        self.command(SETTLES_S + WINDOW_S, &no_jets, |_| no_wheels.clone())?;
        // A pendulum turns by itself: it goes on as it did in as long before.
        let earlier = self.rate()?;
        self.command(length_s + SETTLES_S + WINDOW_S, &no_jets, |_| no_wheels.clone())?;
        let before = self.rate()?;
        let (mut jets, mut wheels) = (no_jets.clone(), no_wheels.clone());
        match part {
            Part::Wheel(index) => wheels.iter_mut().skip(index).take(1).for_each(|u| *u = command),
            Part::Gyro(index) => self.turn_gimbal(index, command),
            Part::Jet(index) => jets.iter_mut().skip(index).take(1).for_each(|t| *t = JET_S),
        }
        let gimbal_angle_rad = self.gimbal_angle_rad.clone();
        let since = Since {
            at: whorl_ros::wall_clock(),
            on_time_s: self.on_time_s.clone(),
            gimbal_angle_rad: gimbal_angle_rad.clone(),
        };
        self.command(length_s, &jets, |_| wheels.clone())?;
        self.gimbal_rate_rad_s.fill(0.0);
        self.command(SETTLES_S + WINDOW_S, &no_jets, |_| no_wheels.clone())?;
        let after = self.rate()?;
        let worked_s = self.worked_s(part, command, &since, after.end);
        let share = after.since(&before) / before.since(&earlier);
        let usual = SHORTEST * length_s..=LONGEST * length_s;
        let trial = Trial {
            part,
            command,
            // A part that did not work although it was told to, again and again, is judged by what it was told.
            length_s: if usual.contains(&worked_s) { worked_s } else { length_s },
            gimbal_angle_rad,
            rate_change_b_rad_s: (after.rate - before.rate) - (before.rate - earlier.rate) * share,
            noise_rad_s: (earlier.noise * share).hypot(after.noise).hypot((1.0 + share) * before.noise),
        };
        let began = earlier.end - Duration::from_secs_f64(WINDOW_S);
        let is_good = worked_s >= SHORTEST * length_s && self.steady(began, after.end);
        Ok(Tried { trial, is_good })
    }

    /// Works every part; what each does.
    fn check(&mut self, model: &PlatformModel, prior: &ModelPrior) -> anyhow::Result<Vec<Checked>> {
        let (no_jets, no_wheels) = (vec![0.0; model.jets().len()], vec![0.0; model.wheels().len()]);
        let mut checked = Vec::new();
        // How each wheel answers to its torque: 1 as it should, -1 the other way, 0 not so that one could use it.
        let mut answers = vec![0.0; model.wheels().len()];
        for part in Part::all(model) {
            self.command(WINDOW_S, &no_jets, |_| no_wheels.clone())?;
            let (command, length_s) = match part {
                Part::Wheel(index) => {
                    (model.wheels().get(index).map_or(0.0, |w| w.max_torque_n_m * WHEEL_SHARE), WHEEL_S)
                }
                Part::Jet(_) => (0.0, JET_S),
                Part::Gyro(index) => {
                    (model.gyros().get(index).map_or(0.0, |g| g.max_rate_rad_s * GIMBAL_SHARE), GIMBAL_S)
                }
            };
            let (finding, settled) = self.find(part, command, length_s, &answers, (model, prior))?;
            let (name, is_right) = (part.name(model), finding.is_right());
            let mut said = finding.words(part, model);
            if !settled {
                said += "; not sure: attempts disagree, or samples came late; try again with less to do for this computer";
            }
            let line = format!("{name:10} {said}");
            if is_right {
                say!("{}", line)
            } else {
                tell(line)
            }
            let size = finding.size();
            checked.push(Checked {
                part: name.to_owned(),
                is_right,
                said,
                size: size.map(|found| found.size),
                stddev: size.map(|found| found.stddev),
                tolerance: size.map(|found| found.tolerance),
            });
            if let Part::Wheel(index) = part {
                answers.iter_mut().skip(index).take(1).for_each(|slot| *slot = finding.answer());
            }
        }
        Ok(checked)
    }

    /// What is found of a part, and whether that is sure.
    fn find(
        &mut self,
        part: Part,
        command: f64,
        length_s: f64,
        answers: &[f64],
        (model, prior): (&PlatformModel, &ModelPrior),
    ) -> anyhow::Result<(Finding, bool)> {
        let (mut attempts, mut command) = (Attempts::default(), command);
        loop {
            let tried = self.try_once(part, command, length_s, model)?;
            self.bring_back(part, command, answers, model)?;
            if let Some(found) = attempts.add(tried, model, prior)? {
                return Ok(found);
            }
            // To and fro, so that attempts do not carry the platform to its stop.
            command = -command;
        }
    }

    /// The platform as it was before a part worked, whichever way it turns.
    fn bring_back(
        &mut self,
        part: Part,
        command: f64,
        answers: &[f64],
        model: &PlatformModel,
    ) -> anyhow::Result<()> {
        let (no_jets, mut wheels) = (vec![0.0; model.jets().len()], vec![0.0; model.wheels().len()]);
        match part {
            Part::Wheel(index) => {
                wheels.iter_mut().skip(index).take(1).for_each(|u| *u = -command);
                self.command(WHEEL_S, &no_jets, |_| wheels.clone())
            }
            Part::Gyro(index) => {
                self.turn_gimbal(index, -command);
                self.command(GIMBAL_S, &no_jets, |_| wheels.clone())?;
                self.gimbal_rate_rad_s.fill(0.0);
                Ok(())
            }
            Part::Jet(_) => self.command(REST_S, &no_jets, |rate| damping(model, answers, rate)),
        }
    }
}
