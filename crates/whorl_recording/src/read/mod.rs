//! Run directories and bags as recordings.

mod assemble;
mod clock;
mod commands;
mod gather;
mod poses;
mod roles;
mod topic_map;
mod valves;
mod wheel_torque;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Unit;
use whorl_bag::{BagReader, RunDirectory};
use whorl_dynamics::PlatformModel;
use whorl_node::Timestamp;

use crate::error::RecordingError;
use crate::model::read_model;
use crate::notes::{START_NOTE, noted_in};
use crate::recording::{Mounting, Recording};
use gather::Gathered;
use roles::{Role, whorl_roles};
use topic_map::TopicMap;

/// Messages of motion after which those of platforms that are not asked for are forgotten, but for their first stamp.
const FORGOTTEN_EVERY: usize = 1000;

/// How a run is to be read.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadOptions<'a> {
    /// Only this platform; `None`: all.
    pub platform: Option<&'a str>,
    /// The platform's model, for what a plain bag does not say: the vector sensor's reference direction, the
    /// order of wheels. A run with other numbers of wheels or jets is refused. `None`: the parameters in the run
    /// directory, if there are any.
    pub model: Option<&'a PlatformModel>,
    /// Which topic holds what, for bags of other systems. `None`: `channels.yaml` in the bag's folder, if there
    /// is one, and else Whorl's own topics.
    pub channels: Option<&'a Path>,
}

/// Reads the measurements of one platform, or of all, out of a run directory, a rosbag2 directory or an
/// `.mcap` file. One [`Recording`] per platform, in the order of the platforms.
///
/// Times count from the start of the run: the first message of the bag, or the first measurement if that is
/// earlier.
///
/// # Errors
/// What is wrong with the run, and what would help.
pub fn read_run(path: &Path, platform: Option<&str>) -> Result<Vec<Recording>, RecordingError> {
    read_run_with(path, &ReadOptions { platform, ..ReadOptions::default() })
}

/// As [`read_run`], told more.
///
/// # Errors
/// As [`read_run`].
pub fn read_run_with(path: &Path, options: &ReadOptions<'_>) -> Result<Vec<Recording>, RecordingError> {
    let run = RunDirectory::open(path)?;
    let bag = run.bag()?;
    if let Some(reason) = nothing_in(&bag) {
        return Err(RecordingError::NothingInBag { path: path.to_owned(), reason });
    }
    let map = topic_map(path, &run, &bag, options)?;
    let roles = match &map {
        None => own_roles(&bag),
        Some(map) => {
            let name = options.platform.or(map.platform.as_deref()).unwrap_or("platform");
            let roles = map.roles.iter();
            roles.map(|(topic, roles)| (topic.clone(), (name.to_owned(), roles.clone()))).collect()
        }
    };
    let platforms = platforms(path, &run, &bag, &roles, options.platform)?;
    let mut remarks: Vec<String> = bag.doubt().map(str::to_owned).into_iter().collect();
    remarks.extend(untyped(&bag, &roles));
    let integrity = bag.integrity();
    if !integrity.complete || integrity.damaged_chunks > 0 {
        remarks.push(format!(
            "The bag is incomplete ({} bytes at its end and {} damaged parts could not be read): the recorder \
             was killed, or the disk was full.",
            integrity.bytes_cut_off, integrity.damaged_chunks
        ));
    }
    let mut gathered: BTreeMap<&str, Gathered> = BTreeMap::new();
    let names: Vec<&String> = roles.keys().collect();
    for message in bag.messages_of(&names) {
        match message {
            Ok(message) => {
                if let Some((platform, roles)) = roles.get(&message.topic.name) {
                    let gathered = gathered.entry(platform).or_insert_with(|| started(map.as_ref()));
                    gathered.add(roles, &message);
                    if !platforms.contains(platform)
                        && gathered.motion_messages.is_multiple_of(FORGOTTEN_EVERY)
                    {
                        gathered.forget();
                    }
                }
            }
            // The reader goes on behind a damaged part.
            Err(error) => remarks.push(format!("A part of the bag cannot be read: {error}.")),
        }
    }
    for gathered in gathered.values() {
        gathered.refuse(path, &bag, &roles)?;
    }
    // All platforms share one start, whichever of them is asked for.
    let first_log = bag.bounds().map(|(first, _)| first);
    let first_log = first_log.filter(|_| gathered.values().all(Gathered::one_clock));
    let start = gathered.values().filter_map(Gathered::first_stamp).chain(first_log).min();
    let noted = noted_in(&run, START_NOTE).and_then(|text| text.parse().ok()).map(Timestamp);
    let start = noted.or(start).unwrap_or(Timestamp(0));
    platforms
        .iter()
        .map(|platform| {
            let mut remarks = remarks.clone();
            let known = match options.model {
                Some(model) => Some(model.clone()),
                None if run.parameter_files().is_empty() => None,
                None => match read_model(path, Some(platform)) {
                    Ok(known) => Some(known.model),
                    Err(error) => {
                        remarks.push(format!("The run's own parameters cannot be used: {error}."));
                        None
                    }
                },
            };
            let gathered = gathered.remove(platform.as_str()).unwrap_or_default();
            let motion_messages = gathered.motion_messages;
            if let Some((joint, present)) = gathered.missing_joints.values().next().cloned() {
                return Err(RecordingError::NoSuchJoint { path: path.to_owned(), joint, present });
            }
            let mut recording =
                assemble::recording(path, &run, platform, gathered, start, known.as_ref(), remarks);
            if let Some(map) = &map {
                recording.closed_loop = map.closed_loop.unwrap_or(recording.closed_loop);
                let held = map.clamped || known.as_ref().is_some_and(|model| !model.freedom.turns());
                recording.mounting = if held { Mounting::Clamped } else { Mounting::OnBearing };
                let jets = known.as_ref().map_or(0, |model| model.jets().len());
                if map.jets_off && recording.jet_pulses.is_empty() {
                    recording.jet_pulses = vec![Vec::new(); jets];
                }
            }
            if let Some(model) = options.model {
                recording.check_fits(model, platform)?;
            }
            if !recording.has_motion() && motion_messages > 0 {
                return Err(RecordingError::NothingFinite {
                    path: path.to_owned(),
                    platform: platform.clone(),
                    messages: motion_messages,
                    said: recording.remarks.join(" "),
                });
            }
            Ok(recording)
        })
        .collect()
}

/// Why there is nothing at all in a bag, if so: nothing was recorded, or it was cut inside its first part.
#[must_use]
pub fn nothing_in(bag: &BagReader) -> Option<String> {
    if !bag.topics().is_empty() {
        return None;
    }
    let integrity = bag.integrity();
    if integrity.complete && integrity.damaged_chunks == 0 {
        return Some("it has no topics: nothing was recorded".to_owned());
    }
    Some(format!(
        "it is incomplete ({} bytes at its end and {} damaged parts cannot be read): the recorder was killed before its first \
         part was whole. With --storage-preset-profile fastwrite, ros2 bag record writes every message at once",
        integrity.bytes_cut_off, integrity.damaged_chunks
    ))
}

/// Says as what topics are read whose type was not stored.
fn untyped(bag: &BagReader, roles: &BTreeMap<String, (String, Vec<Role>)>) -> Vec<String> {
    let of_topic = |(name, (_, roles)): (&String, &(String, Vec<Role>))| {
        bag.topic(name).filter(|topic| topic.type_name.is_empty())?;
        let read_as = roles.first()?.message_type().name();
        Some(format!("The recorder stored no type for {name}: its messages were read as {read_as}."))
    };
    roles.iter().filter_map(of_topic).collect()
}

/// The topic map that is asked for, or the one in a plain bag's folder.
fn topic_map(
    path: &Path,
    run: &RunDirectory,
    bag: &BagReader,
    options: &ReadOptions<'_>,
) -> Result<Option<TopicMap>, RecordingError> {
    let folder = if path.is_dir() { Some(path) } else { path.parent() };
    let beside = folder.map(|folder| folder.join(topic_map::BESIDE_A_BAG));
    let beside = beside.filter(|file| run.manifest().is_none() && file.is_file());
    // A map of other bags says nothing of a run that was made of one of them, and has Whorl's own topics.
    let names_one = |file: &Path| {
        let text = whorl_files::read_text(file).unwrap_or_default();
        bag.topics().iter().any(|topic| text.contains(&topic.name))
    };
    let asked = options.channels.filter(|file| run.manifest().is_none() || names_one(file));
    match asked.map(Path::to_owned).or(beside) {
        None => Ok(None),
        Some(file) => Ok(Some(TopicMap::load(&file, bag)?)),
    }
}

/// An empty collection that knows what the map says.
fn started(map: Option<&TopicMap>) -> Gathered {
    let Some(map) = map else { return Gathered::default() };
    Gathered {
        joints: map.joints.clone(),
        frames: map.frames.clone(),
        efforts_are_measured: !map.effort_is_command,
        references: map.references.iter().map(|r| r.map(Unit::into_inner)).collect(),
        ..Gathered::default()
    }
}

/// Topic -> (platform, roles), by Whorl's own names.
fn own_roles(bag: &BagReader) -> BTreeMap<String, (String, Vec<Role>)> {
    let roles = bag.topics().iter().filter_map(|topic| {
        let (platform, roles) = whorl_roles(topic)?;
        Some((topic.name.clone(), (platform.to_owned(), roles)))
    });
    roles.collect()
}

/// The platforms to read: all that have messages of their motion, or the one that is asked for.
fn platforms(
    path: &Path,
    run: &RunDirectory,
    bag: &BagReader,
    roles: &BTreeMap<String, (String, Vec<Role>)>,
    asked: Option<&str>,
) -> Result<Vec<String>, RecordingError> {
    let moves = |platform: &str| {
        roles.iter().any(|(topic, (owner, roles))| {
            owner == platform
                && roles.iter().any(|role| role.is_measured_motion())
                && bag.topic(topic).is_some_and(|topic| topic.message_count > 0)
        })
    };
    // The manifest knows their order.
    let mut present = run.manifest().map(|m| m.description.platforms.clone()).unwrap_or_default();
    let others: Vec<String> =
        roles.values().map(|(platform, _)| platform.clone()).filter(|p| !present.contains(p)).collect();
    present.extend(others);
    present.dedup();
    present.retain(|platform| moves(platform));
    if present.is_empty() {
        let topics: Vec<&str> = bag.topics().iter().map(|topic| topic.name.as_str()).collect();
        let present = topics.join(", ");
        return Err(RecordingError::NoMeasurements { path: path.to_owned(), present });
    }
    match asked {
        None => Ok(present),
        Some(asked) if present.iter().any(|platform| platform == asked) => Ok(vec![asked.to_owned()]),
        Some(asked) => Err(RecordingError::NoSuchPlatform {
            path: path.to_owned(),
            platform: asked.to_owned(),
            present: present.join(", "),
        }),
    }
}
