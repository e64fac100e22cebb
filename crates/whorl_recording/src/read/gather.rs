//! Messages of one platform, sorted into channels.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector3;
use whorl_bag::{BagReader, Carrier, Channel, Form, RecordedMessage};
use whorl_msgs::Message;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::whorl::ControlStatus;
use whorl_node::Timestamp;

use super::clock::{Clocks, TopicClock};
use super::commands::Commands;
use super::poses;
use super::roles::Role;
use super::valves::{self, Valves};
use crate::columns::Columns;
use crate::error::RecordingError;

/// Values with their stamps \[ns\], in order of arrival.
pub(super) type Samples<T> = Vec<(i64, T)>;

/// Numbers of a channel whose messages say that they were not measured.
#[derive(Debug, Default)]
pub(super) struct Marked {
    pub samples: Columns,
    messages: usize,
    /// The topic, and the field that says so.
    said: Option<(String, &'static str)>,
}

/// What was gathered, by measurement stamp \[ns\].
#[derive(Debug, Default)]
pub(super) struct Gathered {
    /// Finite numbers of every channel and sensor; of one that may lack axes at least one that is finite.
    pub samples: BTreeMap<(Channel, usize), Columns>,
    /// Numbers that were not measured, as their messages say.
    pub marked: BTreeMap<Channel, Marked>,
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
    /// Messages that do not decode, by topic.
    pub undecodable: BTreeMap<String, usize>,
    /// Frame that messages of a topic must name, where the map says one, and how many name another.
    pub frames: BTreeMap<String, String>,
    pub of_other_frames: usize,
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
    /// Of the first message.
    pub clocks: Option<Clocks>,
    /// Of each topic, and of each sender of joints that share one.
    pub topic_clocks: BTreeMap<String, TopicClock>,
    /// The earliest stamp of what was forgotten.
    pub earliest_ns: Option<i64>,
}

impl Gathered {
    pub fn add(&mut self, roles: &[Role], recorded: &RecordedMessage) {
        if roles.first().is_some_and(|role| role.is_pose()) {
            self.add_pose(roles, recorded);
            return;
        }
        // By the role's type: a MagneticField is read as the Vector3Stamped that it begins with.
        let Some(message_type) = roles.first().map(|role| role.message_type()) else { return };
        match Message::decode(message_type, &recorded.cdr) {
            Ok(message) => self.add_message(roles, recorded, &message),
            Err(_) => *self.undecodable.entry(recorded.topic.name.clone()).or_default() += 1,
        }
    }

    /// When a message was measured \[ns\], and whose clock that is; `None` for one of another frame than is asked for.
    fn measured(
        &mut self,
        roles: &[Role],
        recorded: &RecordedMessage,
        stamp_ns: i64,
        frame_id: &str,
        sender: &str,
    ) -> Option<(i64, Clocks)> {
        let topic = &recorded.topic.name;
        if self.frames.get(topic).is_some_and(|wanted| wanted != frame_id) {
            self.of_other_frames += 1;
            return None;
        }
        let key = if sender.is_empty() { topic.clone() } else { format!("{topic} ({sender})") };
        let clock = self.topic_clocks.entry(key).or_default();
        if roles.iter().any(|role| role.is_one_sensor()) {
            clock.sent_by(frame_id);
        }
        let at = clock.measured_ns(recorded.log_time.0, stamp_ns);
        let clocks = clock.clocks().unwrap_or(Clocks::One);
        self.clocks.get_or_insert(clocks);
        Some((at, clocks))
    }

    /// An attitude of another system.
    fn add_pose(&mut self, roles: &[Role], recorded: &RecordedMessage) {
        let Ok(pose) = poses::read(&recorded.topic.type_name, &recorded.cdr) else {
            *self.undecodable.entry(recorded.topic.name.clone()).or_default() += 1;
            return;
        };
        let measured = self.measured(roles, recorded, pose.stamp.0, &pose.frame_id, "");
        let Some((at, _)) = measured else { return };
        for role in roles {
            let numbers = pose.q_world_body.map(|q| match role {
                Role::PoseDirections(_) => [Vector3::x(), Vector3::z()]
                    .map(|v_w| q.inverse_transform_vector(&v_w).as_slice().to_vec())
                    .to_vec(),
                _ => vec![vec![q.w, q.i, q.j, q.k]],
            });
            let (channel, first) = match role {
                Role::PoseDirections(first) => (Channel::Vector, *first),
                _ => (Channel::TrueAttitude, 0),
            };
            match numbers {
                None => *self.not_finite.entry(channel).or_default() += 1,
                Some(all) => {
                    for (n, numbers) in all.into_iter().enumerate() {
                        self.keep(channel, first + n, at, Some(numbers));
                    }
                }
            }
        }
    }

    fn add_message(&mut self, roles: &[Role], recorded: &RecordedMessage, message: &Message) {
        let log_ns = recorded.log_time.0;
        let header = message.header();
        let stamp_ns = header.map_or(log_ns, |header| Timestamp::from(header.stamp).0);
        let frame_id = header.map(|header| header.frame_id.as_str()).unwrap_or_default();
        let sender = match message {
            Message::JointState(m) => m.name.first().map(String::as_str).unwrap_or_default(),
            _ => "",
        };
        let Some((at, clocks)) = self.measured(roles, recorded, stamp_ns, frame_id, sender) else { return };
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
                    let carrier = channel.info().carrier;
                    match (carrier.marked_missing(message), carrier.read_marked(message)) {
                        (None, numbers) => self.keep(channel, sensor, at, numbers),
                        (Some(field), Some(numbers)) => {
                            let marked = self.marked.entry(channel).or_default();
                            marked.samples.push_finite(at, &numbers);
                            marked.messages += 1;
                            marked.said = Some((recorded.topic.name.clone(), field));
                        }
                        (Some(_), None) => {}
                    }
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
        // A sensor may lack axes: which ones is known when all samples are.
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

    /// Refuses messages that are not what they were taken for, and topics of several publishers.
    pub fn refuse(
        &self,
        path: &Path,
        bag: &BagReader,
        roles: &BTreeMap<String, (String, Vec<Role>)>,
    ) -> Result<(), RecordingError> {
        for (topic, count) in &self.undecodable {
            let untyped = bag.topic(topic).filter(|found| found.type_name.is_empty());
            let role = roles.get(topic).and_then(|(_, roles)| roles.first());
            if let (Some(found), Some(role)) = (untyped, role)
                && *count as u64 == found.message_count
            {
                return Err(RecordingError::OtherMessages {
                    path: path.to_owned(),
                    topic: topic.clone(),
                    messages: *count,
                    expected: role.message_type().name(),
                });
            }
        }
        for (topic, clock) in &self.topic_clocks {
            let one_sensor =
                roles.get(topic).is_some_and(|(_, roles)| roles.iter().any(|role| role.is_one_sensor()));
            let reason = clock.several_publishers().or_else(|| self.alternates(roles.get(topic)));
            if let Some(reason) = reason.filter(|_| one_sensor) {
                let (path, topic) = (path.to_owned(), topic.clone());
                return Err(RecordingError::SeveralPublishers { path, topic, reason });
            }
        }
        Ok(())
    }

    /// What shows in the numbers of a topic of one sensor that two sensors send it.
    fn alternates(&self, roles: Option<&(String, Vec<Role>)>) -> Option<String> {
        let (_, roles) = roles?;
        roles.iter().find_map(|role| match role {
            Role::Measured(channel, sensor) if channel.info().is_motion => {
                let samples = self.samples.get(&(*channel, *sensor))?;
                let [one, other] = samples.two_senders()?;
                let shown = |v: &[f64]| v.iter().map(|x| format!("{x:.3}")).collect::<Vec<_>>().join(", ");
                Some(format!(
                    "the {channel} goes to and fro between two readings, such as [{}] and [{}], sample by sample: two sensors send it, and \
                     nothing in the messages tells them apart; record the topic of one",
                    shown(&one), shown(&other)
                ))
            }
            _ => None,
        })
    }

    /// Takes numbers that were not measured, as their messages say, for measured where no message of the channel says otherwise and they
    /// move: many drivers write -1 for a covariance that they do not know. Numbers that never move are none. Says what was done.
    pub fn believe_marked(&mut self) -> Vec<String> {
        let mut remarks = Vec::new();
        for (channel, marked) in std::mem::take(&mut self.marked) {
            let Some((topic, field)) = marked.said else { continue };
            let moves = marked.samples.pairs().any(|((_, before), (_, after))| before != after);
            let has_others = self.samples.get(&(channel, 0)).is_some_and(|samples| !samples.is_empty());
            let says = format!(
                "{} messages of {topic} say by {field}[0] = -1 that the {channel} was not measured (sensor_msgs/Imu)",
                marked.messages
            );
            if moves && !has_others {
                remarks.push(format!("{says}, and yet its numbers move: they were used."));
                self.samples.insert((channel, 0), marked.samples);
            } else {
                let why = if has_others { "others do not" } else { "its numbers never move" };
                remarks.push(format!("{says}, and {why}: they were left out."));
            }
        }
        remarks
    }

    /// Keeps of the samples so far only how early they were.
    pub fn forget(&mut self) {
        self.earliest_ns = self.first_stamp().map(|stamp| stamp.0);
        self.samples.clear();
        self.marked.clear();
        self.wheel_effort = Columns::default();
        self.thrusters.clear();
        self.commands = Commands::default();
    }

    /// The earliest stamp of all.
    pub fn first_stamp(&self) -> Option<Timestamp> {
        let marked = self.marked.values().map(|marked| &marked.samples);
        let samples = self.samples.values().chain(marked).chain([&self.wheel_effort]);
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
