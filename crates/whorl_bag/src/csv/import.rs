//! Measurements from CSV files, as a driver would have sent them, for replay.

use std::path::{Path, PathBuf};

use nalgebra::{Unit, Vector3};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Message, Topic};
use whorl_node::Timestamp;

use super::error::CsvError;
use super::map::CsvMap;
use super::reference::ReferenceSearch;
use super::rows::CsvRow;
use super::sequence::CsvRows;
use crate::channels::{Channel, blank};
use crate::measurements::Measurement;

/// A CSV file of measurements that was read once and found valid.
///
/// Line by line, at time `t - t_first` after the start:
/// - `imu/data_raw` where the gyro has its three numbers, with the latest specific force where the accelerometer has lines of
///   its own;
/// - `vector_sensor/direction` of the first vector sensor, of length 1, where all three are there and are no
///   repetition ([`CsvRows`]);
/// - `wheels/state`, `battery`, `tank_pressure`, `temperature` where there are numbers;
/// - `truth/state` where all four numbers are there. Gyro bias is NaN, and the rate if the file does not have it.
///   Its health is `HEALTH_OK`, or `HEALTH_DEGRADED` in lines that are not to be scored.
#[derive(Debug, Clone, PartialEq)]
pub struct CsvRecording {
    path: PathBuf,
    map: CsvMap,
    vector_reference_world: Option<Unit<Vector3<f64>>>,
    rows: u64,
    duration_s: f64,
}

impl CsvRecording {
    /// Reads the whole file once.
    ///
    /// # Errors
    /// The first thing that is wrong, see [`CsvError`].
    pub fn open(path: &Path, map: &CsvMap) -> Result<Self, CsvError> {
        let mut rows = CsvRows::open(path, map)?;
        let first = map.vectors.first();
        let mut search =
            first.filter(|vector| vector.reference_world.is_none()).map(|_| ReferenceSearch::default());
        let mut vector_reference_world = first.and_then(|vector| vector.reference_world);
        let (mut count, mut first_ns, mut last_ns) = (0, None, 0);
        while let Some(row) = rows.next_row()? {
            count += 1;
            first_ns.get_or_insert(row.time_ns);
            last_ns = row.time_ns;
            if let Some(found) = search.as_mut().and_then(|search| search.add(&row)) {
                vector_reference_world = Some(found);
                search = None;
            }
        }
        let Some(first_ns) = first_ns else { return Err(CsvError::Empty { path: path.to_owned() }) };
        if let Some(search) = search {
            let found = search.at_the_end();
            vector_reference_world =
                Some(found.ok_or_else(|| CsvError::NoReference { path: path.to_owned() })?);
        }
        Ok(Self {
            path: path.to_owned(),
            map: map.clone(),
            vector_reference_world,
            rows: count,
            duration_s: Timestamp(last_ns).seconds_since(Timestamp(first_ns)),
        })
    }

    /// The direction in the world that the first vector sensor measures: from the map, or determined from the
    /// first second in which the body is still. With truth it is the mean of the measurements in the
    /// truth's world. Without, only its angle to the vertical can be known, and north (y) is put where the
    /// measured direction points. `None` without a vector sensor.
    #[must_use]
    pub fn vector_reference_world(&self) -> Option<Unit<Vector3<f64>>> {
        self.vector_reference_world
    }

    /// Lines with numbers.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// From the first to the last line \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The measurements in order; the first line is at `start`. `platform` goes into the frame names.
    ///
    /// # Errors
    /// When the file cannot be opened any more. The items have errors when it has changed since.
    pub fn samples(&self, platform: &str, start: Timestamp) -> Result<CsvSamples, CsvError> {
        Ok(CsvSamples {
            rows: CsvRows::open(&self.path, &self.map)?,
            frame_id: format!("{platform}/base_link"),
            start,
            first_ns: None,
            last_force: None,
            truths: 0,
            pending: Vec::new(),
            failed: false,
        })
    }
}

/// The latest specific force stands for this long beside gyro samples without one \[ns\].
const HELD_NS: i64 = 500_000_000;

/// The measurements of a [`CsvRecording`]; reads the file as it goes.
pub struct CsvSamples {
    rows: CsvRows,
    frame_id: String,
    start: Timestamp,
    first_ns: Option<i64>,
    /// The accelerometer's latest sample, and when that was \[ns\].
    last_force: Option<(i64, Vec<f64>)>,
    truths: u64,
    /// Of the present line, the next one last.
    pending: Vec<Measurement>,
    failed: bool,
}

impl Iterator for CsvSamples {
    type Item = Result<Measurement, CsvError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.pending.is_empty() && !self.failed {
            match self.rows.next_row() {
                Ok(Some(row)) => self.split(row),
                Ok(None) => return None,
                Err(error) => {
                    self.failed = true;
                    return Some(Err(error));
                }
            }
        }
        self.pending.pop().map(Ok)
    }
}

impl CsvSamples {
    /// The line's messages, in reverse: of each topic that a driver sends, where the line has all of its channels.
    fn split(&mut self, row: CsvRow) {
        let first_ns = *self.first_ns.get_or_insert(row.time_ns);
        let stamp = Timestamp(self.start.0.saturating_add(row.time_ns - first_ns));
        let vector = row.vectors_b.first().copied().flatten().map(Unit::into_inner);
        if let Some(force) = row.numbers.get(&Channel::Accelerometer) {
            self.last_force = Some((row.time_ns, force.clone()));
        }
        let latest = self.last_force.as_ref().filter(|(at_ns, _)| row.time_ns - at_ns <= HELD_NS);
        let force =
            latest.filter(|_| row.numbers.contains_key(&Channel::Gyro)).map(|(_, force)| force.clone());
        for topic in Topic::FROM_DRIVER.into_iter().rev() {
            let mut message = None;
            for (channel, _) in Channel::carried_by(topic.info().name) {
                let numbers = match channel {
                    Channel::Vector => vector.map(|v: Vector3<f64>| v.as_slice().to_vec()),
                    Channel::Accelerometer => force.clone(),
                    Channel::TrueAttitude => row.q_world_body.map(|q| vec![q.w, q.i, q.j, q.k]),
                    _ => row.numbers.get(&channel).cloned(),
                };
                // Few files have the true rate; a truth without it is still valid.
                if numbers.is_none() && channel == Channel::TrueRate {
                    continue;
                }
                let Some(numbers) = numbers else {
                    message = None;
                    break;
                };
                let message = message.get_or_insert_with(|| {
                    let world = topic == Topic::TruthState;
                    let frame_id = if world { "world".to_owned() } else { self.frame_id.clone() };
                    let header = Header { stamp: stamp.into(), frame_id };
                    blank(channel.message_type(), header, self.truths)
                });
                channel.info().carrier.write(&numbers, message);
            }
            if let Some(Message::AttitudeEstimate(truth)) = &mut message {
                self.truths += 1;
                if !row.scored {
                    truth.health = AttitudeEstimate::HEALTH_DEGRADED;
                }
            }
            self.pending.extend(message.map(|message| Measurement { stamp, topic, message }));
        }
    }
}

#[cfg(test)]
#[path = "import_tests.rs"]
mod tests;
