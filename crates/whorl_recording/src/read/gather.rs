//! Messages of one platform, sorted into channels.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use whorl_bag::{Carrier, Channel, Form, RecordedMessage};
use whorl_msgs::Message;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::whorl::ControlStatus;
use whorl_node::Timestamp;

use super::commands::Commands;
use super::roles::Role;
use super::valves::{self, Valves};
use crate::columns::Columns;

/// Clocks that differ by more are two clocks, and not one and a delay \[ns\].
const OTHER_CLOCK_NS: i64 = 10_000_000_000;

/// Values with their stamps \[ns\], in order of arrival.
pub(super) type Samples<T> = Vec<(i64, T)>;

/// What was gathered, by measurement stamp \[ns\].
#[derive(Debug, Default)]
pub(super) struct Gathered {
    /// Finite numbers of every channel and sensor; of one that may lack axes at least one that is finite.
    pub samples: BTreeMap<(Channel, usize), Columns>,
    /// Directions in the world that vector sensors see, by sensor.
    pub references: Vec<Option<Vector3<f64>>>,
    /// Torques that the wheels' drives say were in force.
    pub wheel_effort: Columns,
    pub thrusters: Samples<Valves>,
    pub commands: Commands,
    /// Whether any controller said that it was controlling; `None`: none said anything.
    pub controlled: Option<bool>,
    /// Messages of gyro, accelerometer and wheels.
    pub motion_messages: usize,
    /// Messages with numbers that were not finite, by channel.
    pub not_finite: BTreeMap<Channel, usize>,
    /// Messages that do not decode.
    pub undecodable: usize,
    /// Joints that are the wheels, in their order, by channel; of one without: as those of the wheels' speeds, and
    /// without these all joints of a message.
    pub joints: BTreeMap<Channel, Vec<String>>,
    /// Names of the wheels, as their messages have them.
    pub wheel_names: BTreeMap<Channel, Vec<String>>,
    /// A wheel that the map names and no message of the channel has had yet, and what the latest had: several
    /// senders may share a topic.
    pub missing_joints: BTreeMap<Channel, (String, String)>,
    /// Whether efforts are measured and say nothing of commands.
    pub efforts_are_measured: bool,
    pub clocks: Option<Clocks>,
    /// The earliest stamp of what was forgotten.
    pub earliest_ns: Option<i64>,
}

/// How stamps and log times go together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clocks {
    One,
    /// Stamps of another clock than log times.
    Two,
    /// Stamps that nobody set.
    LogOnly,
}

impl Gathered {
    pub fn add(&mut self, roles: &[Role], recorded: &RecordedMessage) {
        // By the role's type: a MagneticField is read as the Vector3Stamped that it begins with.
        let Some(message_type) = roles.first().map(|role| role.message_type()) else { return };
        match Message::decode(message_type, &recorded.cdr) {
            Ok(message) => self.add_message(roles, recorded.log_time.0, &message),
            Err(_) => self.undecodable += 1,
        }
    }

    fn add_message(&mut self, roles: &[Role], log_ns: i64, message: &Message) {
        let stamp_ns = whorl_bag::stamp_of(message).map_or(log_ns, |stamp| stamp.0);
        let clocks = *self.clocks.get_or_insert_with(|| match stamp_ns {
            0 if log_ns > OTHER_CLOCK_NS => Clocks::LogOnly,
            _ if stamp_ns.abs_diff(log_ns) > OTHER_CLOCK_NS.unsigned_abs() => Clocks::Two,
            _ => Clocks::One,
        });
        let at = if clocks == Clocks::LogOnly { log_ns } else { stamp_ns };
        self.motion_messages += usize::from(roles.iter().any(|role| role.is_measured_motion()));
        for role in roles {
            match (*role, message) {
                (Role::Measured(_, _), Message::ThrusterState(m)) => {
                    valves::push(&mut self.thrusters, at, Valves::of(m));
                }
                (Role::Measured(channel, _), Message::JointState(m)) if is_of_wheels(channel) => {
                    self.wheels(channel, at, m);
                }
                (Role::Measured(channel, sensor), message) => {
                    self.keep(channel, sensor, at, channel.info().carrier.read(message));
                }
                (Role::VectorReference(n), Message::Vector3Stamped(m)) => {
                    if self.references.len() <= n {
                        self.references.resize(n + 1, None);
                    }
                    if let Some(reference) = self.references.get_mut(n) {
                        *reference = Some(m.vector.into());
                    }
                }
                (Role::ActuatorCommand, Message::ActuatorCommand(command)) => {
                    // It takes effect when it arrives; its stamp is that of the estimate behind it.
                    let arrived_ns = if clocks == Clocks::Two { stamp_ns } else { log_ns };
                    self.commands.push(arrived_ns, command);
                }
                (Role::ControlStatus, Message::ControlStatus(m)) => {
                    let active = matches!(
                        m.mode,
                        ControlStatus::MODE_TRACK
                            | ControlStatus::MODE_HOLD
                            | ControlStatus::MODE_SAFE_DAMPING
                    );
                    self.controlled = Some(self.controlled.unwrap_or(false) || active);
                }
                // A message is decoded as its role's type: it is no other.
                _ => {}
            }
        }
    }

    /// Keeps a sample if there is one, and counts it if its numbers are not finite.
    fn keep(&mut self, channel: Channel, sensor: usize, at: i64, numbers: Option<Vec<f64>>) {
        let Some(numbers) = numbers else { return };
        // A gyro may lack axes: which ones is known when all samples are.
        if channel.info().may_lack_axes && numbers.len() == 3 && numbers.iter().any(|x| x.is_finite()) {
            self.samples.entry((channel, sensor)).or_default().push(at, &numbers);
            return;
        }
        if !self.samples.entry((channel, sensor)).or_default().push_finite(at, &numbers) {
            *self.not_finite.entry(channel).or_default() += 1;
        }
    }

    /// A channel of the wheels, out of a message that may be about other joints as well.
    fn wheels(&mut self, channel: Channel, at: i64, m: &JointState) {
        let joints = self.joints.get(&channel).or_else(|| self.joints.get(&Channel::WheelSpeed));
        let joints = joints.cloned().unwrap_or_default();
        if self.samples.get(&(channel, 0)).is_none_or(Columns::is_empty) {
            match missing(&joints, &m.name) {
                Some(found) => drop(self.missing_joints.insert(channel, found)),
                None => drop(self.missing_joints.remove(&channel)),
            }
        }
        let names = self.wheel_names.entry(channel).or_default();
        if names.is_empty() {
            names.clone_from(if joints.is_empty() { &m.name } else { &joints });
        }
        let of_wheels = |carrier: Carrier| {
            let numbers = picked(&joints, &m.name, carrier.read(&Message::JointState(m.clone()))?);
            Some(numbers).filter(|numbers| !numbers.is_empty())
        };
        let numbers = of_wheels(channel.info().carrier);
        let effort = of_wheels(Carrier::JointEffort)
            .filter(|_| channel == Channel::WheelSpeed && !self.efforts_are_measured);
        self.keep(channel, 0, at, numbers);
        if let Some(effort) = effort {
            self.wheel_effort.push_finite(at, &effort);
        }
    }

    /// Keeps of the samples so far only how early they were.
    pub fn forget(&mut self) {
        self.earliest_ns = self.first_stamp().map(|stamp| stamp.0);
        self.samples.clear();
        self.wheel_effort = Columns::default();
        self.thrusters.clear();
        self.commands = Commands::default();
    }

    /// The earliest stamp of all.
    pub fn first_stamp(&self) -> Option<Timestamp> {
        let samples = self.samples.values().chain([&self.wheel_effort]);
        let samples = samples.flat_map(|columns| columns.times_ns().iter().copied());
        let valves = self.thrusters.iter().map(|sample| sample.0);
        samples.chain(valves).chain(self.earliest_ns).min().map(Timestamp)
    }

    /// Whether log times are of the clock of the stamps.
    pub fn one_clock(&self) -> bool {
        self.clocks == Some(Clocks::One)
    }
}

/// Gimbals come in the order of the platform's parameters; wheels may stand among other joints.
fn is_of_wheels(channel: Channel) -> bool {
    matches!(channel.info().form, Form::Wheels { .. })
}

/// In order of their stamps, each stamp once; returns how many were left out as doubles.
pub(super) fn in_order<T>(samples: &mut Samples<T>) -> usize {
    let before = samples.len();
    samples.sort_by_key(|(at, _)| *at);
    samples.dedup_by_key(|(at, _)| *at);
    before - samples.len()
}

/// The first of these joints that a message does not have, with those that it has.
fn missing(joints: &[String], names: &[String]) -> Option<(String, String)> {
    let joint = joints.iter().find(|joint| !names.contains(joint))?;
    Some((joint.clone(), names.join(", ")))
}

/// The wheels' part of a message about many joints; empty where one of them is missing.
fn picked(joints: &[String], names: &[String], values: Vec<f64>) -> Vec<f64> {
    if joints.is_empty() {
        return values;
    }
    let place = |joint: &String| names.iter().position(|name| name == joint);
    let value = |joint: &String| place(joint).and_then(|place| values.get(place)).copied();
    joints.iter().map(value).collect::<Option<_>>().unwrap_or_default()
}
