//! A CSV file as a recording.

use std::path::Path;

use nalgebra::{Unit, Vector3};
use whorl_bag::{CsvError, CsvMap, CsvRecording, CsvRow, CsvRows, JetCommand, PlatformParts, Slot};

use crate::series::seconds;
use crate::{
    KnownPlatform, Mounting, OnInterval, Recording, RecordingError, Series, TrueMotion, VectorChannel,
};

/// So many pulse slots are a mistake in the time column.
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
    let motion = [gathered.gyro.len(), gathered.force.len(), gathered.wheel_speed.len()];
    if motion.iter().all(|samples| *samples == 0) {
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
    gyro: Samples<Vector3<f64>>,
    force: Samples<Vector3<f64>>,
    vectors: Vec<Samples<Vector3<f64>>>,
    last_vectors: Vec<Option<Unit<Vector3<f64>>>>,
    repeats: Vec<bool>,
    wheel_speed: Samples<Vec<f64>>,
    wheel_torque: Samples<Vec<f64>>,
    jets: Vec<JetCommand>,
    body_torque: Samples<Vector3<f64>>,
    ballast: Samples<Vector3<f64>>,
    bus_voltage: Samples<f64>,
    tank_pressure: Samples<f64>,
    temperature: Samples<f64>,
    attitude: Samples<nalgebra::UnitQuaternion<f64>>,
    rate: Samples<Vector3<f64>>,
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
        fn push<T>(samples: &mut Samples<T>, at: i64, value: Option<T>) {
            samples.extend(value.map(|value| (at, value)));
        }
        push(&mut self.gyro, at, row.gyro_b_rad_s);
        push(&mut self.force, at, row.specific_force_b_m_s2);
        for (sensor, vector) in row.vectors_b.into_iter().enumerate() {
            let slots = (self.vectors.get_mut(sensor), self.last_vectors.get_mut(sensor));
            if let (Some(vector), (Some(samples), Some(last))) = (vector, slots)
                && (last.replace(vector) != Some(vector) || self.repeats.get(sensor) == Some(&true))
            {
                samples.push((at, vector.into_inner()));
            }
        }
        push(&mut self.wheel_speed, at, row.wheel_speed_rad_s);
        push(&mut self.wheel_torque, at, row.wheel_torque_command_n_m);
        self.jets.extend(row.jets);
        push(&mut self.body_torque, at, row.body_torque_b_n_m);
        push(&mut self.ballast, at, row.ballast_moment_b_n_m);
        push(&mut self.bus_voltage, at, row.bus_voltage_v);
        push(&mut self.tank_pressure, at, row.tank_pressure_pa);
        push(&mut self.temperature, at, row.temperature_k);
        push(&mut self.attitude, at, row.q_world_body);
        push(&mut self.rate, at, row.true_rate_b_rad_s);
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
        fn series<T>(samples: Samples<T>, start: i64) -> Series<T> {
            samples.into_iter().map(|(at, value)| (seconds(at - start), value)).collect()
        }
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
                vectors.push(VectorChannel { reference_world, direction_b: series(samples, start) });
            }
        }
        let mut channels: Vec<(&'static str, usize)> = Vec::new();
        let mut count = |mapped: bool, name: &'static str, samples: usize| {
            if mapped {
                channels.push((name, samples));
                if samples == 0 {
                    remarks.push(format!(
                        "The map names columns for {name}, and no line has numbers in all of them: the channel is \
                         missing."
                    ));
                }
            }
        };
        count(map.gyro.is_some(), "gyro", self.gyro.len());
        count(map.accelerometer.is_some(), "accelerometer", self.force.len());
        let directions = vectors.iter().map(|vector| vector.direction_b.len()).sum();
        count(!map.vectors.is_empty(), "vector sensors", directions);
        count(map.wheel_speed.is_some(), "wheel_speed", self.wheel_speed.len());
        count(map.wheel_torque_command.is_some(), "wheel_torque_command", self.wheel_torque.len());
        count(map.jets.is_some(), "jets", self.jets.len());
        count(map.body_torque.is_some(), "body_torque", self.body_torque.len());
        count(map.ballast_moment.is_some(), "ballast_moment", self.ballast.len());
        count(map.bus_voltage.is_some(), "bus_voltage", self.bus_voltage.len());
        count(map.tank_pressure.is_some(), "tank_pressure", self.tank_pressure.len());
        count(map.temperature.is_some(), "temperature", self.temperature.len());
        count(map.true_attitude.is_some(), "true_attitude", self.attitude.len());
        count(map.true_rate.is_some(), "true_rate", self.rate.len());
        // A channel without a single number was not recorded.
        let jet_pulses = match (map.jets_off, self.jets.is_empty()) {
            (true, _) => vec![Vec::new(); known.model.jets().len()],
            (false, true) => Vec::new(),
            (false, false) => jet_pulses,
        };
        let truth = (!self.attitude.is_empty() || !self.rate.is_empty()).then(|| TrueMotion {
            q_world_body: series(self.attitude, start),
            omega_wb_b_rad_s: series(self.rate, start),
        });
        let mut recording = Recording {
            name: csv.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            platform: known.platform.clone(),
            mounting: if map.clamped { Mounting::Clamped } else { Mounting::OnBearing },
            gyro_b_rad_s: series(self.gyro, start),
            specific_force_b_m_s2: series(self.force, start),
            vectors,
            wheel_speed_rad_s: series(self.wheel_speed, start),
            wheel_torque_command_n_m: series(self.wheel_torque, start),
            jet_pulses,
            body_torque_b_n_m: series(self.body_torque, start),
            bus_voltage_v: series(self.bus_voltage, start),
            tank_pressure_pa: series(self.tank_pressure, start),
            temperature_k: series(self.temperature, start),
            ballast_moment_b_n_m: series(self.ballast, start),
            closed_loop: map.closed_loop,
            truth,
            remarks,
        };
        let suspicions = recording.suspicions(Some(&known.model));
        recording.remarks.extend(suspicions);
        Ok(ImportedCsv { recording, rows: self.rows, channels, ignored })
    }
}
