//! A CSV file as a recording.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector3;
use whorl_bag::{
    Channel, CsvError, CsvMap, CsvRecording, CsvRow, CsvRows, Form, JetCommand, JetMap, PlatformParts, Slot,
};

use crate::RecordingError;
use crate::columns::Columns;
use crate::model::KnownPlatform;
use crate::recording::{Mounting, OnInterval, Recording, VectorChannel, is_whole};
use crate::series::{Series, seconds};

/// More pulse slots than this indicate an error in the time column.
const MOST_SLOTS: i64 = 10_000_000;

/// A CSV file, read.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedCsv {
    /// What was measured; of a file that was read by [`read_csv_beginning`], in its first lines.
    pub recording: Recording,
    /// Lines with numbers.
    pub rows: u64,
    /// From the first of them to the last \[s\].
    pub duration_s: f64,
    /// Whether the recording has what all of them say.
    pub is_whole: bool,
    /// Channels of the map and how many samples each has.
    pub channels: Vec<(&'static str, usize)>,
    /// Columns of the file that the map does not name.
    pub ignored: Vec<String>,
    /// Time of the file that is the recording's zero \[ns\].
    pub(crate) start_ns: i64,
}

/// Names of the platform's wheels and jets, for [`CsvMap::load_for`].
#[must_use]
pub fn platform_parts(known: &KnownPlatform) -> PlatformParts {
    PlatformParts {
        platform: known.platform.clone(),
        wheels: known.model.wheels().iter().map(|wheel| wheel.name.clone()).collect(),
        jets: known.model.jets().iter().map(|jet| jet.name.clone()).collect(),
    }
}

/// Reads a CSV file of one platform.
///
/// # Errors
/// What is wrong with it, with file, line and column.
pub fn read_csv(csv: &Path, map: &CsvMap, known: &KnownPlatform) -> Result<ImportedCsv, RecordingError> {
    read_csv_beginning(csv, map, known, u64::MAX)
}

/// Reads and checks a CSV file of one platform, and keeps the samples of its first lines, for a file that is longer than the
/// memory. Pulses of jets are kept, and everything is counted, to its end.
///
/// # Errors
/// As [`read_csv`].
pub fn read_csv_beginning(
    csv: &Path,
    map: &CsvMap,
    known: &KnownPlatform,
    kept_lines: u64,
) -> Result<ImportedCsv, RecordingError> {
    let (map, left_out) = of_fixed_directions(map);
    let map = &map;
    let (lines, jet_map) = (Lines::new(map), map.jets.clone());
    let mut gathered = Gathered { kept_lines, lines, jet_map, ..Gathered::default() };
    let mut rows = CsvRows::open(csv, map)?;
    while let Some(row) = rows.next_row()? {
        gathered.add(row);
    }
    if gathered.rows == 0 {
        return Err(CsvError::Empty { path: csv.to_owned() }.into());
    }
    if let Some(Slot::Length { ns }) = map.jets.as_ref().map(|jets| jets.slot)
        && (gathered.last_ns - gathered.start_ns()) / ns.max(1) > MOST_SLOTS
    {
        return Err(RecordingError::TooLong {
            path: csv.to_owned(),
            length_s: seconds(gathered.last_ns - gathered.start_ns()),
        });
    }
    if !gathered.samples.keys().any(|(channel, _)| channel.info().is_motion) {
        return Err(RecordingError::NothingInCsv { path: csv.to_owned(), rows: gathered.rows });
    }
    let mut imported = gathered.finish(csv, map, known, &mut rows)?;
    imported.recording.remarks.extend(left_out);
    if !imported.is_whole && imported.recording.vectors.len() < map.vectors.len() {
        // A vector sensor that begins late: which ones there are must be known before the first message is written.
        return read_csv(csv, map, known);
    }
    Ok(imported)
}

/// A map without vector sensors whose direction turns in the world, and a sentence on each: a recording holds one direction of each sensor.
fn of_fixed_directions(map: &CsvMap) -> (CsvMap, Vec<String>) {
    let (mut kept, mut left_out) = (map.clone(), Vec::new());
    kept.vectors.clear();
    for (index, sensor) in map.vectors.iter().enumerate() {
        if sensor.reference_columns.is_none() {
            kept.vectors.push(sensor.clone());
            continue;
        }
        left_out.push(format!(
            "Vector sensor {} is left out: what it sees turns in the world (reference_columns), and a recording holds one direction \
             of each sensor. `whorl estimate` takes such a sensor.",
            index + 1
        ));
    }
    (kept, left_out)
}

/// Numbers of a channel and sensor.
type Sample = (Channel, usize, Vec<f64>);

/// What lines say, one after the other.
#[derive(Debug, Default)]
struct Lines {
    given_start_ns: Option<i64>,
}

impl Lines {
    fn new(map: &CsvMap) -> Self {
        Self { given_start_ns: map.time.start_ns }
    }

    /// The samples of a line; `None` before the start that the map gives.
    fn samples(&self, row: &mut CsvRow) -> Option<Vec<Sample>> {
        if self.given_start_ns.is_some_and(|start| row.time_ns < start) {
            return None;
        }
        let attitude = row.q_world_body.map(|q| (Channel::TrueAttitude, vec![q.w, q.i, q.j, q.k]));
        let numbers = std::mem::take(&mut row.numbers).into_iter().chain(attitude);
        let mut samples: Vec<Sample> = numbers.map(|(channel, numbers)| (channel, 0, numbers)).collect();
        for (sensor, vector) in row.vectors_b.iter().enumerate() {
            if let Some(vector) = vector {
                samples.push((Channel::Vector, sensor, vector.as_slice().to_vec()));
            }
        }
        Some(samples)
    }
}

#[derive(Default)]
struct Gathered {
    lines: Lines,
    /// Lines whose samples are kept.
    kept_lines: u64,
    first_ns: Option<i64>,
    last_ns: i64,
    rows: u64,
    /// Of each channel and sensor; those without a sample are not in it.
    samples: BTreeMap<(Channel, usize), Columns>,
    counts: BTreeMap<Channel, usize>,
    /// Axes of gyro and accelerometer that have a number in some line.
    axes: BTreeMap<Channel, [bool; 3]>,
    /// How the file tells of jets, what it tells but repetitions, and how many lines tell it.
    jet_map: Option<JetMap>,
    jets: Vec<JetCommand>,
    jet_lines: usize,
}

impl Gathered {
    fn start_ns(&self) -> i64 {
        self.lines.given_start_ns.or(self.first_ns).unwrap_or(0)
    }

    fn add(&mut self, mut row: CsvRow) {
        let at = row.time_ns;
        let Some(samples) = self.lines.samples(&mut row) else { return };
        self.first_ns.get_or_insert(at);
        self.last_ns = at;
        self.rows += 1;
        for (channel, sensor, numbers) in samples {
            *self.counts.entry(channel).or_default() += 1;
            if channel.info().may_lack_axes {
                for (seen, x) in self.axes.entry(channel).or_default().iter_mut().zip(&numbers) {
                    *seen |= x.is_finite();
                }
            }
            if self.rows <= self.kept_lines {
                self.samples.entry((channel, sensor)).or_default().push(at, &numbers);
            }
        }
        if let Some((command, map)) = row.jets.zip(self.jet_map.as_ref()) {
            self.jet_lines += 1;
            if self.jets.last().is_none_or(|before| !map.repeats(before, &command)) {
                self.jets.push(command);
            }
        }
    }

    fn finish(
        self,
        csv: &Path,
        map: &CsvMap,
        known: &KnownPlatform,
        read: &mut CsvRows,
    ) -> Result<ImportedCsv, RecordingError> {
        let start = self.start_ns();
        let seconds_at = |at: i64| seconds(at - start);
        let rows = i64::try_from(self.rows).unwrap_or(i64::MAX);
        let row_ns = (self.last_ns - self.first_ns.unwrap_or(0)) / (rows - 1).max(1);
        let jet_pulses = map.jets.as_ref().map_or_else(Vec::new, |jets| {
            let pulses = jets.pulses(&self.jets, row_ns, self.last_ns);
            let interval = |p: &whorl_bag::CsvPulse| OnInterval {
                on_s: seconds_at(p.on_ns),
                off_s: seconds_at(p.off_ns),
            };
            pulses.iter().map(|pulses| pulses.iter().map(interval).collect()).collect()
        });
        let mut remarks = read.notes();
        let mut vectors = Vec::new();
        let mut all = self.samples;
        for (index, sensor) in map.vectors.iter().enumerate() {
            let samples = all.remove(&(Channel::Vector, index)).unwrap_or_default();
            let parameter = known.model.sensors.vector.filter(|_| index == 0);
            let reference_world = match (sensor.reference_world, parameter) {
                (Some(given), _) => given,
                (None, Some(parameter)) => parameter.reference_direction_world,
                // The search looks at the first sensor only.
                (None, None) if index == 0 => {
                    let found = CsvRecording::open(csv, map)?.vector_reference_world();
                    let found = found.ok_or_else(|| CsvError::NoReference { path: csv.to_owned() })?;
                    remarks.push(format!(
                        "The vector sensor's direction in the world was determined from the file: [{:.6}, {:.6}, \
                         {:.6}] (east, north, up). Give reference_world in the map if it is known.",
                        found.x, found.y, found.z
                    ));
                    found
                }
                (None, None) => {
                    return Err(RecordingError::NoReferenceWorld { path: csv.to_owned(), sensor: index + 1 });
                }
            };
            if !samples.is_empty() {
                let direction = |(at, v): (i64, &[f64])| (seconds_at(at), Vector3::from_column_slice(v));
                let direction_b: Series<Vector3<f64>> = samples.lines().map(direction).collect();
                vectors.push(VectorChannel { reference_world, direction_b });
            }
        }
        let mut channels: Vec<(&'static str, usize)> = Vec::new();
        for channel in Channel::ALL.iter().filter(|channel| map.has(**channel)) {
            let (name, samples) = match channel.info().form {
                Form::Directions => ("vector sensors", self.counts.get(channel).copied().unwrap_or(0)),
                Form::Pulses => (channel.info().key, self.jet_lines),
                _ => (channel.info().key, self.counts.get(channel).copied().unwrap_or(0)),
            };
            channels.push((name, samples));
            if samples == 0 {
                remarks.push(format!(
                    "The map names columns for {name}, and no line has numbers in all of them: the channel is \
                     missing."
                ));
            }
        }
        // A channel without a single number was not recorded.
        let jet_pulses = match (map.jets_off, self.jets.is_empty()) {
            (true, _) => vec![Vec::new(); known.model.jets().len()],
            (false, true) => Vec::new(),
            (false, false) => jet_pulses,
        };
        let mut lacks = Vec::new();
        for (channel, seen) in self.axes {
            if let Some(samples) = all.get_mut(&(channel, 0)) {
                lacks.push((channel, samples.take_out_missing_axes(seen.map(|seen| !seen))));
            }
        }
        let held = map.clamped || !known.model.freedom.turns();
        let mut recording = Recording {
            name: csv.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            platform: known.platform.clone(),
            mounting: if held { Mounting::Clamped } else { Mounting::OnBearing },
            vectors,
            jet_pulses,
            closed_loop: map.closed_loop,
            remarks,
            ..Recording::default()
        };
        for (channel, missing) in lacks {
            recording.set_lacks(channel, missing);
        }
        for ((channel, sensor), samples) in all {
            if let Some(series) = recording.series_mut(channel, sensor) {
                series.fill(&mut samples.lines().map(|(at, numbers)| (seconds_at(at), numbers.to_vec())));
            }
        }
        let suspicions = recording.suspicions(Some(&known.model));
        recording.remarks.extend(suspicions);
        Ok(ImportedCsv {
            recording,
            rows: self.rows,
            duration_s: seconds(self.last_ns - self.first_ns.unwrap_or(0)),
            is_whole: self.rows <= self.kept_lines,
            channels,
            ignored: read.unread_columns(),
            start_ns: start,
        })
    }
}

/// The samples of all lines of a file that was read before, in order of time \[ns\] since the recording's zero. It ends at the
/// first error, which the caller finds in `failed`.
pub(crate) fn lines_again<'a>(
    csv: &Path,
    map: &CsvMap,
    imported: &'a ImportedCsv,
    failed: &'a Cell<Option<CsvError>>,
) -> Result<impl Iterator<Item = (i64, Vec<Sample>)> + use<'a>, CsvError> {
    let (map, _) = of_fixed_directions(map);
    let (mut rows, lines) = (CsvRows::open(csv, &map)?, Lines::new(&map));
    let recording = &imported.recording;
    Ok(std::iter::from_fn(move || {
        loop {
            let mut row = match rows.next_row() {
                Ok(row) => row?,
                Err(error) => {
                    failed.set(Some(error));
                    return None;
                }
            };
            let Some(mut samples) = lines.samples(&mut row) else { continue };
            samples.retain_mut(|(channel, _, numbers)| {
                !channel.info().may_lack_axes || is_whole(numbers, recording.lacks(*channel))
            });
            return Some((row.time_ns - imported.start_ns, samples));
        }
    }))
}
