//! A CSV file as a recording.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_bag::{
    Channel, CsvError, CsvMap, CsvRecording, CsvRow, CsvRows, Form, JetCommand, PlatformParts, Slot,
};

use super::columns::Columns;
use crate::RecordingError;
use crate::model::KnownPlatform;
use crate::recording::{Mounting, OnInterval, Recording, VectorChannel};
use crate::series::{Series, seconds};

/// More pulse slots than this indicate an error in the time column.
const MOST_SLOTS: i64 = 10_000_000;

/// A CSV file, read.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedCsv {
    /// What was measured.
    pub recording: Recording,
    /// Lines with numbers.
    pub rows: u64,
    /// Channels of the map and how many samples each has.
    pub channels: Vec<(&'static str, usize)>,
    /// Columns of the file that the map does not name.
    pub ignored: Vec<String>,
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
    let mut gathered = Gathered::new(map);
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
    if !gathered.samples.keys().any(|channel| channel.info().is_motion) {
        return Err(RecordingError::NothingInCsv { path: csv.to_owned(), rows: gathered.rows });
    }
    gathered.finish(csv, map, known, rows.unread_columns())
}

/// Values with the time of their row \[ns\].
type Samples<T> = Vec<(i64, T)>;

#[derive(Default)]
struct Gathered {
    given_start_ns: Option<i64>,
    first_ns: Option<i64>,
    last_ns: i64,
    rows: u64,
    /// Of the channels that are samples of numbers; those without a sample are not in it.
    samples: BTreeMap<Channel, Columns>,
    vectors: Vec<Samples<Vector3<f64>>>,
    last_vectors: Vec<Option<Unit<Vector3<f64>>>>,
    repeats: Vec<bool>,
    jets: Vec<JetCommand>,
}

impl Gathered {
    fn new(map: &CsvMap) -> Self {
        let sensors = map.vectors.len();
        Self {
            given_start_ns: map.time.start_ns,
            vectors: vec![Vec::new(); sensors],
            last_vectors: vec![None; sensors],
            repeats: map.vectors.iter().map(|vector| vector.repeats).collect(),
            ..Self::default()
        }
    }

    fn start_ns(&self) -> i64 {
        self.given_start_ns.or(self.first_ns).unwrap_or(0)
    }

    fn add(&mut self, row: CsvRow) {
        let at = row.time_ns;
        if self.given_start_ns.is_some_and(|start| at < start) {
            return;
        }
        self.first_ns.get_or_insert(at);
        self.last_ns = at;
        self.rows += 1;
        let attitude = row.q_world_body.map(|q| (Channel::TrueAttitude, vec![q.w, q.i, q.j, q.k]));
        for (channel, numbers) in row.numbers.into_iter().chain(attitude) {
            self.samples.entry(channel).or_default().push(at, &numbers);
        }
        for (sensor, vector) in row.vectors_b.into_iter().enumerate() {
            let slots = (self.vectors.get_mut(sensor), self.last_vectors.get_mut(sensor));
            if let (Some(vector), (Some(samples), Some(last))) = (vector, slots)
                && (last.replace(vector) != Some(vector) || self.repeats.get(sensor) == Some(&true))
            {
                samples.push((at, vector.into_inner()));
            }
        }
        self.jets.extend(row.jets);
    }

    fn finish(
        self,
        csv: &Path,
        map: &CsvMap,
        known: &KnownPlatform,
        ignored: Vec<String>,
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
        let mut remarks = Vec::new();
        let mut vectors = Vec::new();
        for (index, (samples, sensor)) in self.vectors.into_iter().zip(&map.vectors).enumerate() {
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
                let direction_b: Series<Vector3<f64>> =
                    samples.into_iter().map(|(at, direction)| (seconds_at(at), direction)).collect();
                vectors.push(VectorChannel { reference_world, direction_b });
            }
        }
        let mut channels: Vec<(&'static str, usize)> = Vec::new();
        for channel in Channel::ALL.iter().filter(|channel| map.has(**channel)) {
            let (name, samples) = match channel.info().form {
                Form::Directions => {
                    ("vector sensors", vectors.iter().map(|vector| vector.direction_b.len()).sum())
                }
                Form::Pulses => (channel.info().key, self.jets.len()),
                _ => (channel.info().key, self.samples.get(channel).map_or(0, Columns::len)),
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
        let mut all = self.samples;
        let no_gyro_axis =
            all.get_mut(&Channel::Gyro).map(Columns::take_out_missing_axes).unwrap_or_default();
        let held = map.clamped || !known.model.freedom.turns();
        let mut recording = Recording {
            name: csv.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            platform: known.platform.clone(),
            no_gyro_axis,
            mounting: if held { Mounting::Clamped } else { Mounting::OnBearing },
            vectors,
            jet_pulses,
            closed_loop: map.closed_loop,
            remarks,
            ..Recording::default()
        };
        for (channel, samples) in all {
            if let Some(series) = recording.series_mut(channel, 0) {
                series.fill(&mut samples.lines().map(|(at, numbers)| (seconds_at(at), numbers.to_vec())));
            }
        }
        let suspicions = recording.suspicions(Some(&known.model));
        recording.remarks.extend(suspicions);
        Ok(ImportedCsv { recording, rows: self.rows, channels, ignored })
    }
}
