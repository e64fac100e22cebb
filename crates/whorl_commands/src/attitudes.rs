//! What attitudes are estimated from: lines of CSV files and samples of recordings; and how good the attitudes are.

use std::path::Path;

use anyhow::bail;
use nalgebra::{UnitQuaternion, Vector3};
use whorl_bag::{Channel, CsvMap, CsvRow, CsvRows, NO_COLUMN, VectorMap};
use whorl_free_motion::{Observed, Orientation, OrientationErrors, Sample, orientation_error};
use whorl_math::quaternion_exp;
use whorl_recording::{Recording, Series};
use whorl_tables::{Table, Values};

use crate::estimate::Recorded;
use crate::own_times::{OwnTimes, Unused};

/// What a filter takes at one time, and the truth to compare with.
#[derive(Debug, Clone)]
pub struct Line {
    /// What was measured.
    pub sample: Sample,
    /// The true attitude, where it counts.
    pub truth: Option<UnitQuaternion<f64>>,
}

/// What a CSV file of this map holds; `name` is that of the map.
#[must_use]
pub fn recorded_by(map: &CsvMap, name: &Path) -> Recorded {
    let vector = |vector: &VectorMap| {
        (vector.columns.join(", "), vector.reference_world.is_some() || vector.reference_columns.is_some())
    };
    Recorded {
        name: name.display().to_string(),
        gyro_axes: axes_of(map, Channel::Gyro).unwrap_or([true; 3]),
        force_axes: axes_of(map, Channel::Accelerometer).unwrap_or_default(),
        vectors: map.vectors.iter().map(vector).collect(),
    }
}

/// Which axes of a channel a map names; `None` where it does not have the channel.
fn axes_of(map: &CsvMap, channel: Channel) -> Option<[bool; 3]> {
    let columns = match map.channels.get(&channel) {
        Some(of) => &of.columns,
        None => &map.angles.iter().find(|of| of.channel == channel)?.columns,
    };
    Some([0, 1, 2].map(|k| columns.get(k).is_some_and(|name| name != NO_COLUMN)))
}

/// Makes lines of the rows of a CSV file: one to each gyro sample, see [`crate::own_times`].
#[derive(Debug)]
pub struct CsvLines<'a> {
    map: &'a CsvMap,
    all: OwnTimes,
}

impl<'a> CsvLines<'a> {
    /// For files of this map.
    #[must_use]
    pub fn new(map: &'a CsvMap) -> Self {
        Self { map, all: OwnTimes::new(map.vectors.len()) }
    }

    /// The line of a row; `None` for one without a gyro sample, or without an accelerometer's before it where that is needed.
    pub fn line(&mut self, row: &CsvRow, needs_force: bool) -> Option<Line> {
        let at_ns = row.time_ns;
        if let Some(force) = row.axes(Channel::Accelerometer) {
            self.all.force(at_ns, force);
        }
        for (k, map) in self.map.vectors.iter().enumerate() {
            let reference_w = row.references_w.get(k).copied().flatten().or(map.reference_world);
            if let Some(body) = vector(row, k) {
                self.all.vector(k, at_ns, Observed { body, reference_w });
            }
        }
        if let Some(truth) = row.q_world_body.filter(|_| row.scored) {
            self.all.truth(at_ns, truth);
        }
        let (sample, truth) = self.all.gyro(at_ns, row.axes(Channel::Gyro)?, needs_force)?;
        Some(Line { sample, truth })
    }

    /// Samples that were of no use so far.
    #[must_use]
    pub fn unused(&self) -> Unused {
        self.all.unused()
    }
}

/// A vector sensor's sample with its length, which reveals disturbances.
fn vector(row: &CsvRow, sensor: usize) -> Option<Vector3<f64>> {
    let direction = row.vectors_b.get(sensor).copied().flatten()?;
    Some(direction.into_inner() * row.vector_lengths.get(sensor).copied().flatten()?)
}

/// All lines of a CSV file.
///
/// # Errors
/// A file that cannot be read.
pub fn lines_of_csv(path: &Path, map: &CsvMap, needs_force: bool) -> anyhow::Result<Vec<Line>> {
    let mut rows = CsvRows::open(path, map)?;
    let (mut reader, mut lines) = (CsvLines::new(map), Vec::new());
    while let Some(row) = rows.next_row()? {
        lines.extend(reader.line(&row, needs_force));
    }
    Ok(lines)
}

/// What a recording holds.
#[must_use]
pub fn recorded_in(recording: &Recording) -> Recorded {
    Recorded {
        name: recording.name.clone(),
        gyro_axes: recording.gyro_axes(),
        force_axes: if recording.specific_force_b_m_s2.is_empty() {
            [false; 3]
        } else {
            recording.force_axes()
        },
        vectors: (1..=recording.vectors.len()).map(|k| (format!("vector_{k}"), true)).collect(),
    }
}

/// All lines of a recording: one to each gyro sample, see [`crate::own_times`].
///
/// # Errors
/// A gyro that lacks axes.
pub fn lines_of(recording: &Recording, needs_force: bool) -> anyhow::Result<Vec<Line>> {
    if !recording.has_whole_gyro() {
        bail!("{}: attitudes need a gyro of three axes", recording.name);
    }
    let gyro = &recording.gyro_b_rad_s;
    let at_ns = |time_s: f64| (time_s * 1e9).round() as i64;
    let mut all = OwnTimes::new(recording.vectors.len());
    let none = Series::default();
    let whole = recording.has_whole_accelerometer();
    let mut force = Upto::new(if whole { &recording.specific_force_b_m_s2 } else { &none });
    let mut vectors: Vec<_> = recording.vectors.iter().map(|sensor| Upto::new(&sensor.direction_b)).collect();
    let mut truth = recording.truth.as_ref().map(|truth| Upto::new(&truth.q_world_body));
    let mut lines = Vec::with_capacity(gyro.len());
    for (time_s, rate) in gyro.time_s.iter().zip(&gyro.value) {
        force.take(*time_s, |at_s, force| all.force(at_ns(at_s), *force));
        for (k, (seen, sensor)) in vectors.iter_mut().zip(&recording.vectors).enumerate() {
            let reference_w = Some(sensor.reference_world);
            seen.take(*time_s, |at_s, body| {
                all.vector(k, at_ns(at_s), Observed { body: *body, reference_w })
            });
        }
        if let Some(truth) = &mut truth {
            truth.take(*time_s, |at_s, q| all.truth(at_ns(at_s), *q));
        }
        let found = all.gyro(at_ns(*time_s), *rate, needs_force);
        lines.extend(found.map(|(sample, truth)| Line { sample, truth }));
    }
    Ok(lines)
}

/// A series that is gone through in order of time.
struct Upto<'a, T> {
    series: &'a Series<T>,
    taken: usize,
}

impl<'a, T> Upto<'a, T> {
    fn new(series: &'a Series<T>) -> Self {
        Self { series, taken: 0 }
    }

    /// Gives what is not later than this and was not given before.
    fn take(&mut self, time_s: f64, mut give: impl FnMut(f64, &T)) {
        while let Some((at_s, value)) =
            self.series.time_s.get(self.taken).zip(self.series.value.get(self.taken))
            && *at_s <= time_s
        {
            give(*at_s, value);
            self.taken += 1;
        }
    }
}

/// An attitude as it is told: `late_s` after the samples that it is of, with the heading turned by `declination`.
#[must_use]
pub fn told(
    mut estimate: Orientation,
    sample: &Sample,
    declination: &UnitQuaternion<f64>,
    late_s: f64,
) -> Orientation {
    let rate = sample.gyro_rad_s - estimate.gyro_bias_rad_s;
    estimate.q_world_body = declination * estimate.q_world_body * quaternion_exp(&(rate * late_s));
    estimate
}

/// Errors against truth, and how many attitudes there are.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    /// Errors where truth is known.
    pub errors: OrientationErrors,
    /// Sum of squared heading errors over their stated variances.
    heading: f64,
    /// Samples with an attitude.
    pub estimates: u64,
}

impl Tally {
    /// Takes in an attitude.
    pub fn add(&mut self, estimate: &Orientation, truth: Option<&UnitQuaternion<f64>>) {
        self.estimates += 1;
        if let Some(truth) = truth {
            self.errors.add(&estimate.q_world_body, truth);
            let [_, heading, _] = orientation_error(&estimate.q_world_body, truth);
            self.heading += heading.powi(2) / estimate.covariance_w_rad2()[(2, 2)].max(f64::MIN_POSITIVE);
        }
    }

    /// Squared heading error over its stated variance, mean; 1 is expected. `None` without truth.
    #[must_use]
    pub fn heading_consistency(&self) -> Option<f64> {
        (self.errors.count() > 0).then(|| self.heading / self.errors.count() as f64)
    }
}

/// Attitudes as a table: time since `first_ns` \[s\], quaternion sensor to world, gyro bias, standard deviations east, north,
/// heading.
#[must_use]
pub fn table(attitudes: &[(i64, Orientation)], first_ns: i64) -> Table {
    type Of = fn(&Orientation) -> f64;
    let sigma = |o: &Orientation, axis: usize| o.covariance_w_rad2()[(axis, axis)].max(0.0).sqrt();
    let times = attitudes.iter().map(|(ns, _)| (ns - first_ns) as f64 * 1e-9);
    let mut table = Table::default().with("time_s", Values::Numbers(times.collect()));
    let columns: [(&str, Of); 7] = [
        ("qw", |o| o.q_world_body.w),
        ("qx", |o| o.q_world_body.i),
        ("qy", |o| o.q_world_body.j),
        ("qz", |o| o.q_world_body.k),
        ("gyro_bias_x_rad_s", |o| o.gyro_bias_rad_s.x),
        ("gyro_bias_y_rad_s", |o| o.gyro_bias_rad_s.y),
        ("gyro_bias_z_rad_s", |o| o.gyro_bias_rad_s.z),
    ];
    for (name, of) in columns {
        table = table.with(name, Values::Numbers(attitudes.iter().map(|(_, o)| of(o)).collect()));
    }
    for (axis, name) in ["sigma_east_rad", "sigma_north_rad", "sigma_heading_rad"].into_iter().enumerate() {
        table = table.with(name, Values::Numbers(attitudes.iter().map(|(_, o)| sigma(o, axis)).collect()));
    }
    table
}
