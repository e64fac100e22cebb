//! Readings against what is predicted of them in a state.

use nalgebra::{Unit, Vector3};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{LinearisedPlant, ROTATION};
use whorl_math::lanes::Sparse;
use whorl_math::{quaternion_exp, unit_or};
use whorl_recording::{Channel, Component};

use crate::noise::{Layout, Noise};
use crate::prepared::Prepared;
use crate::readings::Track;

/// What a reading shows of the state about a prediction.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub component: Component,
    pub track: usize,
    pub sample: usize,
    /// What was read; of a direction NaN.
    pub reading: f64,
    /// Reading less prediction; of a cell the mean.
    pub value: f64,
    /// That of the last reading, in the state of the present instant.
    pub last: f64,
    /// About which a direction's value is an angle, sensor axes.
    pub axis: Vector3<f64>,
    /// How long before the present instant it was read on average, and the mean square of that \[s\] \[s^2\].
    pub lag_s: f64,
    pub lag_squared_s2: f64,
}

impl Row {
    pub fn now(component: Component, track: usize, sample: usize, reading: f64, value: f64) -> Self {
        let (axis, lag_s, lag_squared_s2) = (Vector3::zeros(), 0.0, 0.0);
        Self { component, track, sample, reading, value, last: value, axis, lag_s, lag_squared_s2 }
    }
}

/// Readings of one instant.
#[derive(Debug, Clone, Default)]
pub(crate) struct Readings {
    pub rows: Vec<Row>,
    /// Derivatives of the readings by the state's coordinates, a row each; none: nobody asked.
    pub by_state: Sparse,
    pub variances: Vec<f64>,
}

impl Readings {
    pub fn clear(&mut self) {
        self.rows.clear();
        self.by_state.clear();
        self.variances.clear();
    }

    pub fn push(&mut self, row: Row, variance: f64) {
        self.rows.push(row);
        self.variances.push(variance);
        self.by_state.end_row();
    }
}

/// A state, and the derivatives about it; `None`: only what the readings are less their predictions is wanted.
pub(crate) struct Seen<'a> {
    pub case: &'a Prepared<'a>,
    pub noise: &'a Noise,
    pub layout: Layout,
    pub plant: &'a Plant,
    pub beside: &'a [f64],
    pub linearised: Option<&'a LinearisedPlant>,
}

impl Seen<'_> {
    pub fn read(&self, due: &[(usize, usize)], to: &mut Readings) {
        to.clear();
        let inertial = |track: &Track<'_>| matches!(track.channel, Channel::Gyro | Channel::Accelerometer);
        let tracks = &self.case.tracks;
        let any = due.iter().filter_map(|(position, _)| tracks.get(*position)).any(inertial);
        let imu = if any { self.plant.imu_reading() } else { Default::default() };
        for (position, sample) in due {
            let Some(track) = tracks.get(*position) else { continue };
            if track.channel == Channel::Vector {
                self.direction(track, *position, *sample, to);
            } else {
                self.numbers(track, *position, *sample, &imu, to);
            }
        }
    }

    fn numbers(
        &self,
        track: &Track<'_>,
        position: usize,
        sample: usize,
        imu: &(Vector3<f64>, Vector3<f64>),
        to: &mut Readings,
    ) {
        let (layout, n) = (self.layout, self.layout.plant.size());
        for component in &track.components {
            let index = component.index();
            let Some(reading) = track.number(sample, index) else { continue };
            let (predicted, bias) = match track.channel {
                Channel::Gyro => (imu.0.get(index), layout.gyro_bias()),
                Channel::Accelerometer => (imu.1.get(index), layout.force_bias()),
                _ => (self.plant.state().wheel_speed_rad_s().get(index), 0..0),
            };
            let mut predicted = predicted.copied().unwrap_or(f64::NAN);
            if let Some(linearised) = self.linearised {
                let mut set_row = |row: usize| {
                    (0..n).for_each(|i| to.by_state.set(i, linearised.imu_by_state[(row, i)]));
                };
                match track.channel {
                    Channel::Gyro => set_row(index),
                    Channel::Accelerometer => {
                        set_row(3 + index);
                        let by_torque = linearised.force_by_torque.row(index);
                        for (k, i) in layout.disturbance().enumerate() {
                            to.by_state.set(i, by_torque[k % 3]);
                        }
                        for (i, wheel) in layout.motors().zip(self.case.model().wheels()) {
                            to.by_state.set(i, -by_torque.transpose().dot(&wheel.spin_axis_b));
                        }
                    }
                    _ => to.by_state.set(layout.plant.wheels().start + index, 1.0),
                }
                if !bias.is_empty() {
                    to.by_state.set(bias.start + index, 1.0);
                }
            }
            if !bias.is_empty() {
                predicted += self.beside[bias.start + index];
            }
            let row = Row::now(*component, position, sample, reading, reading - predicted);
            to.push(row, self.noise.of(*component).powi(2));
        }
    }

    /// The angle from the predicted direction to the one that was read, about two axes across it.
    fn direction(&self, track: &Track<'_>, position: usize, sample: usize, to: &mut Readings) {
        let Some((reading, reference)) = track.vector(sample).zip(self.case.reference(track.sensor)) else {
            return;
        };
        let sensor = self.plant.gyrostat().model().sensors.vector;
        let misalignment_rad = sensor.map_or(Vector3::zeros(), |v| v.misalignment_rad);
        let to_sensor = quaternion_exp(&misalignment_rad).inverse();
        let predicted = to_sensor * self.plant.state().q_world_body.inverse_transform_vector(&reference);
        let measured = unit_or(reading, Unit::new_unchecked(predicted));
        let across = predicted.cross(&measured);
        let sine = across.norm();
        let off = if sine > 0.0 { across * (sine.atan2(predicted.dot(&measured)) / sine) } else { across };
        let helper = if predicted.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
        let first = unit_or(predicted.cross(&helper), Vector3::x_axis()).into_inner();
        let second = predicted.cross(&first);
        for (component, axis) in track.components.iter().zip([first, second]) {
            // A body turned by a sees the direction turned by -a.
            if self.linearised.is_some() {
                let by_turn = to_sensor.inverse() * axis;
                (0..3).for_each(|i| to.by_state.set(ROTATION.start + i, -by_turn[i]));
            }
            let (component, value) = (*component, off.dot(&axis));
            let row = Row { axis, ..Row::now(component, position, sample, f64::NAN, value) };
            to.push(row, self.noise.of(component).powi(2));
        }
    }
}

/// Sums of readings of a cell less their predictions, on the way to its end, one for each component.
#[derive(Debug, Clone, Default)]
pub(crate) struct Collected(Vec<Sum>);

#[derive(Debug, Clone)]
struct Sum {
    /// Of values and lags, of which the samples are the last.
    row: Row,
    count: f64,
    /// The same of directions, sensor axes.
    along: Vector3<f64>,
}

impl Collected {
    pub fn clear(&mut self) {
        self.0.clear();
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds what was read so long before the end \[s\].
    pub fn add(&mut self, readings: &Readings, lag_s: f64) {
        for row in &readings.rows {
            let lags = Row { lag_s, lag_squared_s2: lag_s * lag_s, ..*row };
            let along = row.axis * row.value;
            match self.0.iter_mut().find(|sum| sum.row.component == row.component) {
                None => self.0.push(Sum { row: lags, count: 1.0, along }),
                Some(Sum { row: sum, count, along: all }) => {
                    sum.sample = row.sample;
                    sum.value += row.value;
                    sum.lag_s += lag_s;
                    sum.lag_squared_s2 += lags.lag_squared_s2;
                    *count += 1.0;
                    *all += along;
                }
            }
        }
    }

    /// The last of each sensor: track and sample.
    pub fn last(&self, due: &mut Vec<(usize, usize)>) {
        due.clear();
        for Sum { row, .. } in &self.0 {
            match due.iter_mut().find(|(track, _)| *track == row.track) {
                Some((_, sample)) => *sample = row.sample.max(*sample),
                None => due.push((row.track, row.sample)),
            }
        }
        due.sort_unstable();
    }

    /// Means in the place of the last of each.
    pub fn put(&self, readings: &mut Readings) {
        for (row, variance) in readings.rows.iter_mut().zip(&mut readings.variances) {
            let Some(Sum { row: sum, count, .. }) =
                self.0.iter().find(|sum| sum.row.component == row.component)
            else {
                continue;
            };
            let of_track = || self.0.iter().filter(|other| other.row.track == sum.track);
            let is_direction = row.axis != Vector3::zeros();
            let value = if is_direction {
                of_track().map(|other| other.along.dot(&row.axis)).sum()
            } else {
                sum.value
            };
            row.value = value / count;
            *variance /= count;
            (row.lag_s, row.lag_squared_s2) = (sum.lag_s / count, sum.lag_squared_s2 / count);
        }
    }
}
