//! A recording as a run directory.

use std::iter::Peekable;
use std::path::{Path, PathBuf};

use whorl_bag::{BagOptions, Channel, Form, RawSample, RunDescription, RunWriter, blank, extra};
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::ThrusterState;
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;

use crate::error::RecordingError;
use crate::model::KnownPlatform;
use crate::notes::{CLOSED_LOOP_NOTE, MOUNTING_NOTE, START_NOTE};
use crate::recording::{Mounting, Recording};
use crate::series::{ChannelSeries, nanoseconds as ns};

/// How a recording came about, for the manifest.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunOrigin {
    /// Name of the experiment.
    pub experiment: String,
    /// Version of the program that writes.
    pub version: String,
    /// When it was recorded, or is written \[UTC\].
    pub start_utc: Timestamp,
    /// Further facts, such as the file that it was imported from.
    pub notes: Vec<(String, String)>,
}

/// Writes a recording as a run directory: bag, the platform's parameters, manifest. [`crate::read_run`] gives it
/// back; everything that reads runs can read it.
///
/// # Errors
/// When the directory holds a run already, or cannot be written.
pub fn write_run(
    recording: &Recording,
    known: &KnownPlatform,
    origin: &RunOrigin,
    out: &Path,
) -> Result<PathBuf, RecordingError> {
    let mut notes = origin.notes.clone();
    let mounting = match recording.mounting {
        Mounting::OnBearing => "on_bearing",
        Mounting::Clamped => "clamped",
    };
    notes.push((MOUNTING_NOTE.to_owned(), mounting.to_owned()));
    notes.push((CLOSED_LOOP_NOTE.to_owned(), recording.closed_loop.to_string()));
    notes.push((START_NOTE.to_owned(), "0".to_owned()));
    let description = RunDescription {
        experiment: origin.experiment.clone(),
        version: origin.version.clone(),
        simulated_time: true,
        platforms: vec![recording.platform.clone()],
        notes,
        ..RunDescription::default()
    };
    let mut writer = RunWriter::create_in(out, description, origin.start_utc, BagOptions::default())?;
    for file in &known.files {
        writer.add_parameter_file(file)?;
    }
    let wheels: Vec<String> = known.model.wheels().iter().map(|wheel| wheel.name.clone()).collect();
    let mut streams = streams(recording, &wheels);
    let mut encoded = Vec::new();
    while let Some((at, name, message)) = next(&mut streams) {
        let log_time = Timestamp(at);
        match Topic::find(&name, true) {
            Some(topic) => writer.write_message(Route::platform(PlatformId(0), topic), log_time, &message)?,
            // A topic that only recordings have.
            None => {
                let name = format!("/{}/{name}", recording.platform);
                let handle = writer.add_topic(&name, message.message_type().name(), "", None)?;
                message
                    .encode_into(&mut encoded)
                    .map_err(|source| whorl_bag::BagError::Encode { topic: name, source })?;
                let sample = RawSample { log_time, publish_time: log_time, origin: None, cdr: &encoded };
                writer.write_raw(handle, sample)?;
            }
        }
    }
    let path = writer.path().to_owned();
    writer.finish(origin.start_utc)?;
    Ok(path)
}

/// Time of a message \[ns\], name of its topic in the platform's namespace, and the message.
type Timed = (i64, String, Message);

/// The messages of one topic, in order of time, made when they are asked for: those of a long recording take many times its
/// memory.
type Stream<'a> = Peekable<Box<dyn Iterator<Item = Timed> + 'a>>;

/// The channels that share a topic.
type Shared<'a> = Vec<(Channel, &'a dyn ChannelSeries)>;

/// The earliest message; of several at one time that of the first topic.
fn next(streams: &mut [Stream<'_>]) -> Option<Timed> {
    let times = streams.iter_mut().enumerate().filter_map(|(i, stream)| Some((stream.peek()?.0, i)));
    let (_, earliest) = times.min()?;
    streams.get_mut(earliest)?.next()
}

fn streams<'a>(recording: &'a Recording, wheels: &'a [String]) -> Vec<Stream<'a>> {
    let frame = format!("{}/base_link", recording.platform);
    let header = move |at: i64| Header { stamp: Timestamp(at).into(), frame_id: frame.clone() };
    let in_world = |at: i64| Header { stamp: Timestamp(at).into(), frame_id: "world".to_owned() };
    let mut out: Vec<Stream<'a>> = Vec::new();
    let mut add = |stream: Box<dyn Iterator<Item = Timed> + 'a>| out.push(stream.peekable());
    for (sensor, channel) in recording.vectors.iter().enumerate() {
        let first = channel.direction_b.time_s.first().map_or(0, |t| ns(*t));
        let vector = channel.reference_world.into_inner().into();
        let reference = Vector3Stamped { header: in_world(first), vector };
        add(Box::new(std::iter::once((first, extra::vector_reference(sensor), reference.into()))));
    }
    let mut topics: Vec<(String, Shared<'a>)> = Vec::new();
    for (channel, sensor, series) in recording.sampled() {
        let name = channel.topic_name(sensor);
        match topics.iter_mut().find(|(known, _)| *known == name) {
            Some((_, shared)) => shared.push((channel, series)),
            None => topics.push((name, vec![(channel, series)])),
        }
    }
    for (name, shared) in topics {
        let is_truth = name == Topic::TruthState.info().name;
        let header = header.clone();
        let messages = (0..).zip(merged(shared)).filter_map(move |(sequence, (at, samples))| {
            let header = if is_truth { in_world(at) } else { header(at) };
            let (first, _) = samples.first()?;
            let mut message = blank(first.message_type(), header, sequence);
            if let (Message::JointState(state), Form::Wheels { .. }) = (&mut message, first.info().form) {
                state.name = wheels.to_vec();
            }
            for (channel, mut numbers) in samples {
                if channel == Channel::Gyro {
                    // Not measured is not zero.
                    for (x, missing) in numbers.iter_mut().zip(recording.no_gyro_axis) {
                        if missing {
                            *x = f64::NAN;
                        }
                    }
                }
                channel.info().carrier.write(&numbers, &mut message);
            }
            Some((at, name.clone(), message))
        });
        add(Box::new(messages));
    }
    if !recording.jet_pulses.is_empty() {
        add(Box::new(valves(recording, header)));
    }
    out
}

/// Numbers of the channels that have a sample at one time.
type Samples = Vec<(Channel, Vec<f64>)>;

/// What each channel has at each time of any of them, in order of time \[ns\].
fn merged(shared: Shared<'_>) -> impl Iterator<Item = (i64, Samples)> {
    let mut next = vec![0; shared.len()];
    std::iter::from_fn(move || {
        let due = shared.iter().zip(&next).filter_map(|((_, series), next)| series.time_s().get(*next));
        let at = due.map(|t| ns(*t)).min()?;
        let samples = shared.iter().zip(&mut next).filter_map(|((channel, series), next)| {
            series.time_s().get(*next).filter(|t| ns(**t) == at)?;
            *next += 1;
            Some((*channel, series.numbers(*next - 1)))
        });
        Some((at, samples.collect()))
    })
}

/// A message at the start and at each edge of a valve: from these the reader has every pulse to the nanosecond.
fn valves(recording: &Recording, header: impl Fn(i64) -> Header) -> impl Iterator<Item = Timed> {
    let jets = recording.jet_pulses.len();
    // (time, jet, whether it opens): it shuts before it opens again.
    let mut edges: Vec<(i64, usize, bool)> = Vec::new();
    for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
        for pulse in pulses {
            let (on, off) = (ns(pulse.on_s), ns(pulse.off_s));
            edges.push((on, jet, true));
            edges.push((off, jet, false));
        }
    }
    edges.sort_unstable();
    let first = edges.first().map_or(i64::MAX, |edge| edge.0);
    let start = recording.first_time_s().map_or(first, |t| ns(t).min(first));
    let mut times: Vec<i64> = std::iter::once(start).chain(edges.iter().map(|edge| edge.0)).collect();
    times.dedup();
    let (mut open, mut total_ns) = (vec![false; jets], vec![0i64; jets]);
    let mut next = edges.into_iter().peekable();
    let mut before_ns = start;
    (0..).zip(times).map(move |(sequence, at)| {
        let before = total_ns.clone();
        for (total, _) in total_ns.iter_mut().zip(&open).filter(|(_, open)| **open) {
            *total += at - before_ns;
        }
        before_ns = at;
        while let Some((_, jet, opens)) = next.next_if(|edge| edge.0 == at) {
            if let Some(open) = open.get_mut(jet) {
                *open = opens;
            }
        }
        let on_ns = total_ns.iter().zip(&before).map(|(now, before)| now - before);
        let message = ThrusterState {
            header: header(at),
            sequence,
            valve_open: open.clone(),
            on_time_s: on_ns.map(|ns| ns as f64 * 1e-9).collect(),
            total_on_time_s: total_ns.iter().map(|ns| *ns as f64 * 1e-9).collect(),
            health: vec![ThrusterState::HEALTH_OK; jets],
        };
        (at, Channel::Jets.topic_name(0), message.into())
    })
}
