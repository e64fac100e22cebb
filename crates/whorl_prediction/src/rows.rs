//! Readings against what is predicted of them in a state.

use nalgebra::{DMatrix, DVector, Unit, Vector3};
use whorl_dynamics::Plant;
use whorl_dynamics::plant::{LinearisedPlant, ROTATION};
use whorl_math::{quaternion_exp, unit_or};
use whorl_recording::{Channel, Component};

use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::readings::Track;

/// What a reading shows of the state about a prediction.
pub(crate) struct Row {
    pub component: Component,
    pub track: usize,
    pub sample: usize,
    /// What was read; of a direction NaN.
    pub reading: f64,
    /// Reading less prediction.
    pub value: f64,
    /// Variance of the reading itself.
    pub variance: f64,
    /// Derivative of the reading by the state's coordinates.
    pub by_state: DVector<f64>,
}

/// How the readings of an instant were taken in, one number after the other.
pub(crate) struct Taken {
    /// By how much each changes the state, a column each.
    pub gains: DMatrix<f64>,
    /// The same of the estimate of the start, if that is asked for.
    pub of_start: Option<DMatrix<f64>>,
    /// Innovations and their variances.
    pub values: Vec<f64>,
    pub variances: Vec<f64>,
}

impl Taken {
    /// Of a state of this size, and a start of that one.
    pub fn new(size: usize, readings: usize, start: Option<usize>) -> Self {
        Self {
            gains: DMatrix::zeros(size, readings),
            of_start: start.map(|start| DMatrix::zeros(start, readings)),
            values: Vec::with_capacity(readings),
            variances: Vec::with_capacity(readings),
        }
    }

    /// The next.
    pub fn add(&mut self, value: f64, variance: f64, gain: &DVector<f64>) {
        self.gains.set_column(self.values.len(), gain);
        self.values.push(value);
        self.variances.push(variance);
    }
}

/// A state, and the derivatives about it; `None`: only what the readings are less their predictions is wanted.
pub(crate) struct Seen<'a> {
    pub case: &'a Prepared<'a>,
    pub noise: &'a Noise,
    pub layout: Layout,
    pub plant: &'a Plant,
    pub beside: &'a DVector<f64>,
    pub linearised: Option<&'a LinearisedPlant>,
}

impl Seen<'_> {
    /// Of these tracks and samples, read now.
    pub fn rows(&self, due: &[(usize, usize)]) -> Vec<Row> {
        let mut rows = Vec::with_capacity(16);
        let inertial = |track: &Track<'_>| matches!(track.channel, Channel::Gyro | Channel::Accelerometer);
        let tracks = self.case.tracks();
        let any = due.iter().filter_map(|(position, _)| tracks.get(*position)).any(inertial);
        let imu = if any { self.plant.imu_reading() } else { Default::default() };
        for (position, sample) in due {
            let Some(track) = tracks.get(*position) else { continue };
            if track.channel == Channel::Vector {
                self.direction(track, *position, *sample, &mut rows);
            } else {
                self.numbers(track, *position, *sample, &imu, &mut rows);
            }
        }
        rows
    }

    fn numbers(
        &self,
        track: &Track<'_>,
        position: usize,
        sample: usize,
        imu: &(Vector3<f64>, Vector3<f64>),
        rows: &mut Vec<Row>,
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
            let mut by_state = self.no_derivative();
            if let Some(linearised) = self.linearised {
                match track.channel {
                    Channel::Gyro => {
                        by_state.rows_mut(0, n).copy_from(&linearised.imu_by_state.row(index).transpose());
                    }
                    Channel::Accelerometer => {
                        by_state
                            .rows_mut(0, n)
                            .copy_from(&linearised.imu_by_state.row(3 + index).transpose());
                        let by_torque = linearised.force_by_torque.row(index);
                        for (axis, i) in layout.disturbance().enumerate() {
                            by_state[i] = by_torque[axis];
                        }
                        for (i, wheel) in layout.motors().zip(self.case.model().wheels()) {
                            by_state[i] = -by_torque.transpose().dot(&wheel.spin_axis_b);
                        }
                    }
                    _ => by_state[layout.plant.wheels().start + index] = 1.0,
                }
                if !bias.is_empty() {
                    by_state[bias.start + index] = 1.0;
                }
            }
            if !bias.is_empty() {
                predicted += self.beside[bias.start + index];
            }
            let value = reading - predicted;
            rows.push(self.row(*component, position, sample, reading, value, by_state));
        }
    }

    /// The angle from the predicted direction to the one that was read, about two axes across it.
    fn direction(&self, track: &Track<'_>, position: usize, sample: usize, rows: &mut Vec<Row>) {
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
            let mut by_state = self.no_derivative();
            if self.linearised.is_some() {
                by_state.rows_mut(ROTATION.start, 3).copy_from(&-(to_sensor.inverse() * axis));
            }
            rows.push(self.row(*component, position, sample, f64::NAN, off.dot(&axis), by_state));
        }
    }

    fn no_derivative(&self) -> DVector<f64> {
        DVector::zeros(if self.linearised.is_some() { self.layout.size() } else { 0 })
    }

    fn row(
        &self,
        component: Component,
        track: usize,
        sample: usize,
        reading: f64,
        value: f64,
        by_state: DVector<f64>,
    ) -> Row {
        let variance = self.noise.of(component).powi(2);
        Row { component, track, sample, reading, value, variance, by_state }
    }
}
