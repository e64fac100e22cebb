//! A recording as a run directory.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::iter::Peekable;
use std::path::{Path, PathBuf};

use whorl_bag::{BagOptions, Channel, CsvMap, Form, RawSample, RunDescription, RunWriter, blank, extra};
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::ThrusterState;
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;

use crate::csv::{ImportedCsv, lines_again};
use crate::error::RecordingError;
use crate::model::KnownPlatform;
use crate::notes::{CLOSED_LOOP_NOTE, MOUNTING_NOTE, START_NOTE};
use crate::recording::{Mounting, Recording, VectorChannel};
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
    let writer = started(recording, known, origin, out)?;
    let wheels = names_of_wheels(known);
    finish(write_streams(writer, recording, streams(recording, &wheels))?, origin)
}

/// Writes a CSV file as a run directory, whose beginning was read: line by line, however long it is.
///
/// # Errors
/// As [`write_run`], and when the file cannot be read again.
pub fn write_long_csv(
    csv: &Path,
    map: &CsvMap,
    imported: &ImportedCsv,
    known: &KnownPlatform,
    origin: &RunOrigin,
    out: &Path,
) -> Result<PathBuf, RecordingError> {
    let recording = &imported.recording;
    let failed = Cell::new(None);
    let lines = lines_again(csv, map, imported, &failed)?;
    let writer = started(recording, known, origin, out)?;
    let wheels = names_of_wheels(known);
    let mut streams = references(recording);
    let mut messages = Messages::new(recording, &wheels);
    let of_lines = lines.flat_map(move |(at, samples)| {
        // Of each topic the channels that it carries, in the order of the channels.
        let mut topics: Vec<(String, Samples)> = Vec::new();
        for (channel, sensor, numbers) in samples {
            let name = channel.topic_name(sensor);
            match topics.iter_mut().find(|(known, _)| *known == name) {
                Some((_, shared)) => shared.push((channel, numbers)),
                None => topics.push((name, vec![(channel, numbers)])),
            }
        }
        topics.into_iter().filter_map(|(name, samples)| messages.make(&name, at, samples)).collect::<Vec<_>>()
    });
    let of_lines: Box<dyn Iterator<Item = Timed> + '_> = Box::new(of_lines);
    streams.push(of_lines.peekable());
    streams.extend(valve_stream(recording));
    let writer = write_streams(writer, recording, streams)?;
    match failed.take() {
        Some(error) => Err(error.into()),
        None => finish(writer, origin),
    }
}

fn started(
    recording: &Recording,
    known: &KnownPlatform,
    origin: &RunOrigin,
    out: &Path,
) -> Result<RunWriter, RecordingError> {
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
    Ok(writer)
}

fn names_of_wheels(known: &KnownPlatform) -> Vec<String> {
    known.model.wheels().iter().map(|wheel| wheel.name.clone()).collect()
}

/// Writes every message of the streams in order of time, and closes the run; its directory.
fn write_streams(
    mut writer: RunWriter,
    recording: &Recording,
    mut streams: Vec<Stream<'_>>,
) -> Result<RunWriter, RecordingError> {
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
    Ok(writer)
}

fn finish(writer: RunWriter, origin: &RunOrigin) -> Result<PathBuf, RecordingError> {
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

fn header(recording: &Recording, at: i64) -> Header {
    Header { stamp: Timestamp(at).into(), frame_id: format!("{}/base_link", recording.platform) }
}

fn header_in_world(at: i64) -> Header {
    Header { stamp: Timestamp(at).into(), frame_id: "world".to_owned() }
}

/// What each vector sensor sees in the world, once.
fn references<'a>(recording: &Recording) -> Vec<Stream<'a>> {
    let of = |(sensor, channel): (usize, &VectorChannel)| {
        let first = channel.direction_b.time_s.first().map_or(0, |t| ns(*t));
        let vector = channel.reference_world.into_inner().into();
        let reference = Vector3Stamped { header: header_in_world(first), vector };
        let message: Timed = (first, extra::vector_reference(sensor), reference.into());
        let stream: Box<dyn Iterator<Item = Timed> + 'a> = Box::new(std::iter::once(message));
        stream.peekable()
    };
    recording.vectors.iter().enumerate().map(of).collect()
}

/// Of jets, if there are any.
fn valve_stream(recording: &Recording) -> Option<Stream<'_>> {
    let stream: Box<dyn Iterator<Item = Timed> + '_> =
        Box::new(valves(recording, |at| header(recording, at)));
    (!recording.jet_pulses.is_empty()).then(|| stream.peekable())
}

/// Makes messages of samples, and counts those of each topic.
struct Messages<'a> {
    recording: &'a Recording,
    wheels: &'a [String],
    counts: BTreeMap<String, u64>,
}

impl<'a> Messages<'a> {
    fn new(recording: &'a Recording, wheels: &'a [String]) -> Self {
        Self { recording, wheels, counts: BTreeMap::new() }
    }

    /// What a topic's channels have at one time.
    fn make(&mut self, name: &str, at: i64, samples: Samples) -> Option<Timed> {
        let is_truth = name == Topic::TruthState.info().name;
        let header = if is_truth { header_in_world(at) } else { header(self.recording, at) };
        let (first, _) = samples.first()?;
        let count = match self.counts.get_mut(name) {
            Some(count) => count,
            None => self.counts.entry(name.to_owned()).or_default(),
        };
        let mut message = blank(first.message_type(), header, *count);
        *count += 1;
        if let (Message::JointState(state), Form::Wheels { .. }) = (&mut message, first.info().form) {
            state.name = self.wheels.to_vec();
        }
        for (channel, mut numbers) in samples {
            // Not measured is not zero.
            for (x, missing) in numbers.iter_mut().zip(self.recording.lacks(channel)) {
                if missing {
                    *x = f64::NAN;
                }
            }
            channel.info().carrier.write(&numbers, &mut message);
        }
        Some((at, name.to_owned(), message))
    }
}

fn streams<'a>(recording: &'a Recording, wheels: &'a [String]) -> Vec<Stream<'a>> {
    let mut out = references(recording);
    let mut topics: Vec<(String, Shared<'a>)> = Vec::new();
    for (channel, sensor, series) in recording.sampled() {
        let name = channel.topic_name(sensor);
        match topics.iter_mut().find(|(known, _)| *known == name) {
            Some((_, shared)) => shared.push((channel, series)),
            None => topics.push((name, vec![(channel, series)])),
        }
    }
    for (name, shared) in topics {
        let mut messages = Messages::new(recording, wheels);
        let made = merged(shared).filter_map(move |(at, samples)| messages.make(&name, at, samples));
        let made: Box<dyn Iterator<Item = Timed> + 'a> = Box::new(made);
        out.push(made.peekable());
    }
    out.extend(valve_stream(recording));
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
