//! Measurements from CSV files.

use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Topic, geometry_msgs, std_msgs};
use whorl_node::Timestamp;

use super::reference::ReferenceSearch;
use super::table::{Column, Table};
use super::{CsvError, CsvMap};
use crate::measurements::Measurement;

/// A CSV file of measurements that was read once and found to be good.
///
/// Line by line, at time `t - t_first` after the start:
/// - `imu/data_raw` where all six numbers are there;
/// - `vector_sensor/direction`, of length 1, where all three are there and differ from those of the line
///   before: files often repeat the last value of a slower sensor, and a repeated value is no measurement;
/// - `truth/state` where all four numbers are there. Rates and gyro bias are NaN: the file does not know
///   them. Its health is `HEALTH_OK`, or `HEALTH_DEGRADED` in lines that are not to be scored.
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
        let mut rows = Rows::open(path, map)?;
        let mut search = map
            .vector
            .as_ref()
            .filter(|vector| vector.reference_world.is_none())
            .map(|_| ReferenceSearch::default());
        let mut vector_reference_world = map.vector.as_ref().and_then(|vector| vector.reference_world);
        let (mut count, mut first_s, mut last_s) = (0, None, 0.0);
        while let Some(row) = rows.next()? {
            count += 1;
            first_s.get_or_insert(row.time_s);
            last_s = row.time_s;
            if let Some(found) = search.as_mut().and_then(|search| search.add(&row)) {
                vector_reference_world = Some(found);
                search = None;
            }
        }
        let Some(first_s) = first_s else { return Err(CsvError::Empty { path: path.to_owned() }) };
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
            duration_s: last_s - first_s,
        })
    }

    /// The direction in the world that the vector sensor measures: from the map, or determined from the
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
            rows: Rows::open(&self.path, &self.map)?,
            frame_id: format!("{platform}/base_link"),
            start,
            first_s: None,
            last_vector: None,
            truths: 0,
            pending: Vec::new(),
            failed: false,
        })
    }
}

/// One line in SI units.
pub(crate) struct Row {
    pub time_s: f64,
    /// Rate [rad/s] and specific force [m/s^2], body axes.
    pub imu: Option<(Vector3<f64>, Vector3<f64>)>,
    pub vector_b: Option<Unit<Vector3<f64>>>,
    pub q_world_body: Option<UnitQuaternion<f64>>,
    pub scored: bool,
}

/// Reads lines and checks them.
struct Rows {
    path: PathBuf,
    table: Table,
    map: CsvMap,
    time: Column,
    gyro: [Column; 3],
    accelerometer: [Column; 3],
    vector: Option<[Column; 3]>,
    truth: Option<[Column; 4]>,
    scored: Option<Column>,
    previous_s: Option<f64>,
}

impl Rows {
    fn open(path: &Path, map: &CsvMap) -> Result<Self, CsvError> {
        let table = Table::open(path, map.delimiter)?;
        let scored = map.true_attitude.as_ref().and_then(|truth| truth.scored_column.as_ref());
        Ok(Self {
            path: path.to_owned(),
            time: table.column(&map.time_column)?,
            gyro: table.columns(&map.gyro_columns)?,
            accelerometer: table.columns(&map.accelerometer_columns)?,
            vector: map.vector.as_ref().map(|vector| table.columns(&vector.columns)).transpose()?,
            truth: map.true_attitude.as_ref().map(|truth| table.columns(&truth.columns)).transpose()?,
            scored: scored.map(|name| table.column(name)).transpose()?,
            table,
            map: map.clone(),
            previous_s: None,
        })
    }

    fn next(&mut self) -> Result<Option<Row>, CsvError> {
        if !self.table.advance()? {
            return Ok(None);
        }
        let time_s = self.time()?;
        let gyro = self.table.numbers(&self.gyro)?.map(|v| Vector3::from(v) * self.map.gyro_unit_rad_s);
        let force = self
            .table
            .numbers(&self.accelerometer)?
            .map(|v| Vector3::from(v) * self.map.accelerometer_unit_m_s2);
        let vector = self.vector.map(|columns| self.table.numbers(&columns)).transpose()?.flatten();
        let truth = self.truth.map(|columns| self.table.numbers(&columns)).transpose()?.flatten();
        let scored = self.scored.map(|column| self.table.number(column)).transpose()?.flatten();
        let world_to_body = self.map.true_attitude.as_ref().is_some_and(|truth| truth.world_to_body);
        Ok(Some(Row {
            time_s,
            imu: gyro.zip(force),
            // A vector of no length has no direction: no measurement.
            vector_b: vector.and_then(|v| Unit::try_new(Vector3::from(v), 1e-12)),
            q_world_body: truth.and_then(|[w, x, y, z]| {
                let q = Quaternion::new(w, x, y, z);
                let q = (q.norm() > 1e-6).then(|| UnitQuaternion::from_quaternion(q))?;
                Some(if world_to_body { q.inverse() } else { q })
            }),
            scored: self.scored.is_none() || scored.is_some_and(|scored| scored != 0.0),
        }))
    }

    fn time(&mut self) -> Result<f64, CsvError> {
        let line = self.table.line();
        let Some(time) = self.table.number(self.time)? else {
            return Err(CsvError::NotANumber {
                path: self.path.clone(),
                line,
                column: self.map.time_column.clone(),
                text: String::new(),
            });
        };
        let time_s = time * self.map.time_unit_s;
        if let Some(previous_s) = self.previous_s.replace(time_s)
            && time_s <= previous_s
        {
            let (path, column) = (self.path.clone(), self.map.time_column.clone());
            return Err(CsvError::TimeOrder { path, line, column, time_s, previous_s });
        }
        Ok(time_s)
    }
}

/// The measurements of a [`CsvRecording`]; reads the file as it goes.
pub struct CsvSamples {
    rows: Rows,
    frame_id: String,
    start: Timestamp,
    first_s: Option<f64>,
    last_vector: Option<Unit<Vector3<f64>>>,
    truths: u64,
    /// Of the present line, the next one last.
    pending: Vec<Measurement>,
    failed: bool,
}

impl Iterator for CsvSamples {
    type Item = Result<Measurement, CsvError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.pending.is_empty() && !self.failed {
            match self.rows.next() {
                Ok(Some(row)) => self.split(&row),
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
    fn split(&mut self, row: &Row) {
        let first_s = *self.first_s.get_or_insert(row.time_s);
        let stamp = Timestamp(self.start.0.saturating_add(Timestamp::from_seconds(row.time_s - first_s).0));
        let header = |frame_id: &str| std_msgs::Header { stamp: stamp.into(), frame_id: frame_id.to_owned() };
        let mut push = |topic, message| self.pending.push(Measurement { stamp, topic, message });
        if let Some(q) = row.q_world_body {
            let unknown = geometry_msgs::Vector3 { x: f64::NAN, y: f64::NAN, z: f64::NAN };
            let truth = AttitudeEstimate {
                header: header("world"),
                sequence: self.truths,
                q_world_body: geometry_msgs::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
                omega_wb_b_rad_s: unknown,
                gyro_bias_b_rad_s: unknown,
                nis: f64::NAN,
                health: if row.scored {
                    AttitudeEstimate::HEALTH_OK
                } else {
                    AttitudeEstimate::HEALTH_DEGRADED
                },
                ..AttitudeEstimate::default()
            };
            self.truths += 1;
            push(Topic::TruthState, truth.into());
        }
        if let Some(vector) = row.vector_b
            && self.last_vector.replace(vector) != Some(vector)
        {
            let vector = <[f64; 3]>::from(vector.into_inner()).into();
            let direction = Vector3Stamped { header: header(&self.frame_id), vector };
            push(Topic::VectorDirection, direction.into());
        }
        if let Some((gyro, force)) = row.imu {
            let mut imu = Imu {
                header: header(&self.frame_id),
                angular_velocity: <[f64; 3]>::from(gyro).into(),
                linear_acceleration: <[f64; 3]>::from(force).into(),
                ..Imu::default()
            };
            // There is no orientation in this message.
            imu.orientation_covariance[0] = -1.0;
            push(Topic::ImuRaw, imu.into());
        }
    }
}

#[cfg(test)]
#[path = "import_tests.rs"]
mod tests;
