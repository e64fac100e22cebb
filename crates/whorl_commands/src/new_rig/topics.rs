//! A map of the topics of a bag: by their types.

use std::collections::BTreeMap;

use whorl_bag::{BagReader, BagTopic, Channel};
use whorl_msgs::geometry_msgs::Vector3;
use whorl_msgs::{Message, MessageType};

use super::channels::{Entry, MapDraft};
use super::lines::{Origin, Sourced, quoted};

/// Messages of a topic by which its frames and halves are told.
const LOOKED_AT: usize = 2_000;
/// Begins as `Vector3Stamped` does.
const MAGNETIC_FIELD: &str = "sensor_msgs/msg/MagneticField";
/// Attitudes of other systems.
const POSES: [&str; 3] =
    ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped", "nav_msgs/msg/Odometry"];

/// What inertial messages of a topic have.
#[derive(Debug, Default)]
struct Inertial {
    gyro: usize,
    force: usize,
    /// Messages that say that there is no gyro, or no accelerometer, the first numbers of these, and whether others are different.
    marked: [(usize, Option<[f64; 3]>, bool); 2],
    frames: BTreeMap<String, usize>,
}

/// The draft of a bag's map, and the names of the wheels, if there are any.
///
/// # Errors
/// A bag without any topic that measures motion.
pub fn draft(bag: &BagReader) -> anyhow::Result<(MapDraft, Vec<String>)> {
    if let Some(reason) = whorl_recording::nothing_in(bag) {
        anyhow::bail!("{reason}");
    }
    let mut draft = MapDraft { is_bag: true, ..MapDraft::default() };
    let mut topics: Vec<&BagTopic> = bag.topics().iter().map(|topic| &**topic).collect();
    topics.retain(|topic| topic.message_count > 0);
    // The fullest first.
    topics.sort_by_key(|topic| std::cmp::Reverse(topic.message_count));
    let of_type = |wanted: &str, words: &[&str]| -> Vec<&BagTopic> {
        let is = |topic: &&&BagTopic| {
            let untyped = topic.type_name.is_empty() && words.iter().any(|word| topic.name.contains(word));
            topic.type_name == wanted || untyped
        };
        topics.iter().filter(is).copied().collect()
    };
    inertial(bag, &of_type(MessageType::Imu.name(), &["imu", "gyro", "accel"]), &mut draft);
    let mut fields = of_type(MAGNETIC_FIELD, &["mag"]);
    let directions = ["vector", "direction", "sun", "mag", "lamp", "star"];
    let vectors = of_type(MessageType::Vector3Stamped.name(), &[]);
    fields
        .extend(vectors.into_iter().filter(|topic| directions.iter().any(|word| topic.name.contains(word))));
    for (topic, channel, key) in
        fields.first().map(|topic| (*topic, Channel::Vector, "vector")).into_iter().chain(
            [
                (MessageType::BatteryState, Channel::BusVoltage),
                (MessageType::FluidPressure, Channel::TankPressure),
                (MessageType::Temperature, Channel::Temperature),
            ]
            .into_iter()
            .filter_map(|(kind, channel)| {
                let first = of_type(kind.name(), &[]).first().copied()?;
                Some((first, channel, channel.info().topic_key))
            }),
        )
    {
        draft.entries.push(of_topic(topic, channel, key));
    }
    let wheels = joints(bag, &of_type(MessageType::JointState.name(), &["joint", "wheel"]), &mut draft);
    if let Some(pose) = POSES.iter().find_map(|kind| of_type(kind, &[]).first().copied()) {
        let mut entry = of_topic(pose, Channel::TrueAttitude, "pose");
        entry.of.words =
            "taken as the true attitude, body to world; `use: directions` takes it as measured".to_owned();
        draft.entries.push(entry);
    }
    let used = |name: &str| draft.entries.iter().any(|entry| entry.columns.iter().any(|topic| topic == name));
    draft.ignored = topics.iter().map(|topic| topic.name.clone()).filter(|name| !used(name)).collect();
    if !draft.entries.iter().any(|entry| entry.channel.info().is_motion) {
        let present: Vec<String> =
            topics.iter().map(|topic| format!("{} ({})", topic.name, or_unknown(&topic.type_name))).collect();
        anyhow::bail!(
            "no topic measures motion: one of sensor_msgs/msg/Imu or sensor_msgs/msg/JointState is needed; there are: {}",
            if present.is_empty() { "none".to_owned() } else { present.join(", ") }
        );
    }
    Ok((draft, wheels))
}

fn or_unknown(type_name: &str) -> &str {
    if type_name.is_empty() { "type not stored" } else { type_name }
}

fn of_topic(topic: &BagTopic, channel: Channel, key: &str) -> Entry {
    let (origin, words) = if topic.type_name.is_empty() {
        (Origin::Assumed, "by its name, as its type was not stored; check it".to_owned())
    } else {
        (Origin::Stated, format!("{} messages of {}", topic.message_count, topic.type_name))
    };
    Entry {
        key: key.to_owned(),
        channel,
        columns: vec![topic.name.clone()],
        of: Sourced::new((), origin, words),
        unit: None,
        more: Vec::new(),
    }
}

/// One topic with gyro and accelerometer, or two with a half each.
fn inertial(bag: &BagReader, topics: &[&BagTopic], draft: &mut MapDraft) {
    let looked: Vec<(&BagTopic, Inertial)> =
        topics.iter().map(|topic| (*topic, look(bag, &topic.name))).collect();
    let more_of = |a: usize, b: usize| a > 0 && b * 10 < a;
    let whole = looked.iter().find(|(_, found)| found.gyro > 0 && found.force > 0);
    let gyro = looked.iter().find(|(_, found)| more_of(found.gyro, found.force));
    let force = looked.iter().find(|(_, found)| more_of(found.force, found.gyro));
    let chosen: Vec<(&(&BagTopic, Inertial), &str, Channel)> = match (whole, gyro, force) {
        (Some(whole), ..) => vec![(whole, "imu", Channel::Gyro)],
        (None, Some(gyro), Some(force)) => {
            vec![(gyro, "gyro", Channel::Gyro), (force, "accelerometer", Channel::Accelerometer)]
        }
        (None, Some(gyro), None) => vec![(gyro, "gyro", Channel::Gyro)],
        (None, None, Some(force)) => vec![(force, "accelerometer", Channel::Accelerometer)],
        (None, None, None) => return,
    };
    for ((topic, found), key, channel) in chosen {
        let mut entry = of_topic(topic, channel, key);
        if found.frames.len() > 1
            && let Some((frame, count)) = found.frames.iter().max_by_key(|(_, count)| **count)
        {
            entry.more.push(format!("frame_id: {}", quoted(frame)));
            let all: Vec<String> =
                found.frames.iter().map(|(frame, n)| format!("{frame} {n} times")).collect();
            entry.of = Sourced::new(
                (),
                Origin::Assumed,
                format!(
                    "several sensors publish the topic ({}); {count} messages are of this one; check it",
                    all.join(", ")
                ),
            );
        }
        draft.entries.push(entry);
    }
    let others: Vec<&str> = looked
        .iter()
        .filter(|(_, found)| found.gyro + found.force > 0)
        .map(|(topic, _)| topic.name.as_str())
        .filter(|name| !draft.entries.iter().any(|entry| entry.columns.iter().any(|topic| topic == name)))
        .collect();
    if !others.is_empty() {
        draft.notes.push(format!("Other inertial sensors are not in the map: {}.", others.join(", ")));
    }
}

fn look(bag: &BagReader, topic: &str) -> Inertial {
    let mut found = Inertial::default();
    for message in bag.messages_of(&[topic]).flatten().take(LOOKED_AT) {
        let Ok(Message::Imu(imu)) = Message::decode(MessageType::Imu, &message.cdr) else { continue };
        *found.frames.entry(imu.header.frame_id.clone()).or_default() += 1;
        // A covariance that begins with -1 means that there is no such sensor; the recording believes numbers that move more than that.
        // Of a sensor that lacks axes the others have numbers.
        let mut has = |sensor: usize, covariance: &[f64; 9], v: &Vector3| {
            let numbers = [v.x, v.y, v.z];
            let is_there = numbers.iter().any(|x| x.is_finite());
            let is_marked = covariance.first() == Some(&-1.0);
            if let Some((count, first, moves)) =
                found.marked.get_mut(sensor).filter(|_| is_there && is_marked)
            {
                *count += 1;
                *moves |= *first.get_or_insert(numbers) != numbers;
            }
            usize::from(is_there && !is_marked)
        };
        let gyro = has(0, &imu.angular_velocity_covariance, &imu.angular_velocity);
        let force = has(1, &imu.linear_acceleration_covariance, &imu.linear_acceleration);
        found.gyro += gyro;
        found.force += force;
    }
    let [gyro, force] = found.marked.map(|(count, _, moves)| if moves { count } else { 0 });
    if found.gyro == 0 {
        found.gyro = gyro;
    }
    if found.force == 0 {
        found.force = force;
    }
    found
}

/// The first topic of joints that turn; their names.
fn joints(bag: &BagReader, topics: &[&BagTopic], draft: &mut MapDraft) -> Vec<String> {
    for topic in topics {
        for message in bag.messages_of(&[topic.name.as_str()]).flatten().take(LOOKED_AT) {
            let Ok(Message::JointState(state)) = Message::decode(MessageType::JointState, &message.cdr)
            else {
                continue;
            };
            if state.name.is_empty() || state.velocity.len() != state.name.len() {
                continue;
            }
            let mut entry = of_topic(topic, Channel::WheelSpeed, Channel::WheelSpeed.info().topic_key);
            let names: Vec<String> = state.name.iter().map(|name| quoted(name)).collect();
            entry.more.push(format!("joints: [{}]", names.join(", ")));
            entry.of = Sourced::new((), Origin::Assumed, "all joints are taken for wheels; check it");
            draft.entries.push(entry);
            return state.name;
        }
    }
    Vec::new()
}
