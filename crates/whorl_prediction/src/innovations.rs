//! The mean of the state on its way through a recording, and what readings are less their predictions: with any gains.

use std::cell::Cell;

use nalgebra::{DVector, Unit, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, MeanInputs, Plant, ROTATION};
use whorl_math::lanes::Gain;
use whorl_math::{quaternion_exp, unit_or};
use whorl_recording::{Channel, Component};

use crate::commands::Inputs;
use crate::readings::Cursor;
use crate::rows::{Collected, Readings};
use crate::stop::obey;
use crate::within::Within;
use crate::{Layout, Noise, Prepared, Start};

thread_local! {
    static INSTANTS: Cell<u64> = const { Cell::new(0) };
}

/// Instants at which anything was taken in on this thread since it began: over those of a recording, how many passes a computation was worth.
pub fn instants_on_this_thread() -> u64 {
    INSTANTS.get()
}

/// A reading less what was predicted from everything before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// The instant that the reading shows, time since the start of the run \[s\].
    pub time_s: f64,
    /// Which sensor, and which of its sample, from 0.
    pub component: Component,
    /// Sample of its series.
    pub sample: usize,
    /// Reading less prediction, in the channel's unit; of a direction the angle about one of two axes across it \[rad\].
    pub value: f64,
    /// Its predicted standard deviation, in the same unit.
    pub stddev: f64,
}

impl Innovation {
    /// Over its predicted deviation: independent and standard normal for the true model.
    pub fn normalised(&self) -> f64 {
        self.value / self.stddev
    }

    /// Its part of the log likelihood, -1/2 (e^2/S + log 2 pi S).
    pub fn log_likelihood(&self) -> f64 {
        -0.5 * (self.normalised().powi(2) + (std::f64::consts::TAU * self.stddev * self.stddev).ln())
    }
}

pub(crate) struct Mean<'a> {
    pub case: &'a Prepared<'a>,
    pub noise: &'a Noise,
    pub layout: Layout,
    pub plant: Plant,
    /// Disturbances and biases: what the state has besides the plant's, by [`Layout`]; entries of the plant are zero.
    pub beside: DVector<f64>,
    pub event: usize,
    cursor: Cursor,
    /// Where the present cell of readings ends \[ns\], and what was read in it.
    end_ns: i64,
    pub collected: Collected,
    /// Mean inputs over the accelerometer's window there.
    at_end: Option<MeanInputs>,
    /// Until when inputs of the cell are summed up \[ns\], and to what they have come: times seconds.
    from_ns: i64,
    inputs: Inputs,
    /// Whether anybody asks what inputs do within cells.
    pub sees_inputs: bool,
    pub apart: Within,
    within: Readings,
    /// What was read at the present instant: tracks and samples.
    pub due: Vec<(usize, usize)>,
    /// Innovations of the present instant, and by how much they change the state.
    pub values: Vec<f64>,
    change: Vec<f64>,
    pub lost: bool,
}

impl<'a> Mean<'a> {
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start) -> Self {
        let mut plant = case.plant.clone();
        start.put(&mut plant);
        Self {
            case,
            noise,
            layout: start.layout,
            plant,
            beside: start.beside.clone(),
            event: case.event,
            cursor: Cursor::new(&case.tracks),
            end_ns: i64::MIN,
            collected: Collected::default(),
            at_end: None,
            from_ns: i64::MIN,
            inputs: [0.0; MeanInputs::COUNT],
            sees_inputs: false,
            apart: Within::default(),
            within: Readings::default(),
            due: Vec::new(),
            values: Vec::new(),
            change: Vec::new(),
            lost: false,
        }
    }

    /// Sets out to the instant at which the next readings are taken in \[ns\]; `None` behind the last. What is read then is known before: what a platform
    /// does there is what others begin with.
    pub fn set_out(&mut self) -> Option<i64> {
        self.end_ns = self.case.cell_end_ns(self.cursor.instant_ns(&self.case.tracks)?);
        self.collected.sums.clear();
        (self.from_ns, self.inputs) = (self.plant.now_ns(), [0.0; MeanInputs::COUNT]);
        self.at_end = self.case.mean_inputs(self.end_ns);
        self.plant.average_readings(self.at_end);
        Some(self.end_ns)
    }

    /// Goes to an instant; what is read on the way, within a cell, is collected.
    pub fn advance(&mut self, end_ns: i64) {
        while let Some(instant_ns) = self.cursor.instant_ns(&self.case.tracks)
            && instant_ns < self.end_ns
            && instant_ns <= end_ns
            && !self.lost
        {
            self.go(instant_ns);
            self.collect(instant_ns);
            // What a window of the accelerometer sees is that about the end of the cell for everybody else.
            self.plant.average_readings(self.at_end);
        }
        self.go(end_ns);
    }

    /// Tells the plant the disturbances as they are now, and with it the models that take over its motion.
    pub fn disturb(&mut self) {
        let (torques, noise) = (self.layout.disturbance(), &self.noise.disturbance);
        for (k, process) in noise.body.iter().enumerate().take(torques.len() / 3) {
            let now_n_m = Vector3::from_fn(|i, _| self.beside[torques.start + 3 * k + i]);
            self.plant.set_disturbance(k, now_n_m, 1.0 / process.correlation_s);
        }
        let of_motors = self.layout.motors().map(|i| self.beside[i]);
        self.plant.set_motor_disturbances(of_motors, 1.0 / noise.motors_correlation_s);
    }

    /// Moves the plant to an instant, while disturbances fade.
    fn go(&mut self, to_ns: i64) {
        self.disturb();
        let from_ns = self.plant.now_ns();
        self.lost |= !self.case.commands.run_to(&mut self.plant, &mut self.event, to_ns);
        let after_s = (to_ns - from_ns) as f64 * 1e-9;
        for (i, _, correlation_s) in self.noise.disturbance.coordinates(self.layout) {
            self.beside[i] *= (-after_s / correlation_s).exp();
        }
    }

    /// Finds what is taken in at the present instant.
    pub fn find_due(&mut self, instant_ns: i64) {
        INSTANTS.set(INSTANTS.get() + 1);
        obey();
        if self.collected.sums.is_empty() {
            self.cursor.take(&self.case.tracks, instant_ns, &mut self.due);
        } else {
            self.collect(instant_ns);
            self.apart.add(self.case, &self.collected);
            self.collected.last(&mut self.due);
        }
    }

    fn collect(&mut self, instant_ns: i64) {
        self.cursor.take(&self.case.tracks, instant_ns, &mut self.due);
        if self.reads_imu() {
            self.plant.average_readings(self.case.mean_inputs(instant_ns));
        }
        let mut within = std::mem::take(&mut self.within);
        self.read_of(&self.plant, &self.beside, None, &mut within);
        if self.sees_inputs {
            let [from_s, to_s] = [self.from_ns, instant_ns].map(|time_ns| time_ns as f64 * 1e-9);
            let now = self.case.commands.mean_between(from_s, to_s).numbers();
            self.inputs.iter_mut().zip(now).for_each(|(sum, now)| *sum += now * (to_s - from_s));
            self.from_ns = instant_ns;
        }
        let lag_s = (self.end_ns - instant_ns) as f64 * 1e-9;
        self.collected.add(&within, lag_s, self.sees_inputs.then_some(&self.inputs));
        self.within = within;
    }

    /// Whether gyro or accelerometer is due: a gyro may be sensitive to force.
    fn reads_imu(&self) -> bool {
        let channel = |of: &(usize, usize)| self.case.tracks[of.0].channel;
        self.due.iter().any(|of| matches!(channel(of), Channel::Gyro | Channel::Accelerometer))
    }

    pub fn take_in(&mut self, readings: &Readings, gain: &Gain, told: &mut dyn FnMut(&Innovation)) {
        let time_s = self.plant.now_ns() as f64 * 1e-9;
        self.values.clear();
        self.change.clear();
        self.change.resize(self.layout.size(), 0.0);
        for (r, (row, variance)) in readings.rows.iter().zip(&gain.variances).enumerate() {
            let before = gain.couplings(r).iter().zip(&self.values);
            let value = row.value - before.map(|(coupling, e)| coupling * e).sum::<f64>();
            // Without a value the motion is beyond repair.
            if !value.is_finite() {
                self.lost = true;
                return;
            }
            let (component, sample) = (row.component, row.sample);
            told(&Innovation { time_s, component, sample, value, stddev: variance.sqrt() });
            self.values.push(value);
            self.change.iter_mut().zip(gain.of(r)).for_each(|(change, gain)| *change += gain * value);
        }
        self.apply_change();
    }

    pub fn change(&mut self, change: &DVector<f64>) {
        self.change.clear();
        self.change.extend(change.iter());
        self.apply_change();
    }

    fn apply_change(&mut self) {
        let n = self.layout.plant.size();
        (n..self.layout.size()).for_each(|i| self.beside[i] += self.change[i]);
        self.plant.change_state(&self.change[..n]);
    }

    /// Reads what is due against this state; derivatives are those about it.
    pub fn read(&self, linearised: Option<&LinearisedPlant>, to: &mut Readings) {
        self.read_of(&self.plant, &self.beside, linearised, to);
        self.collected.put(to);
    }

    /// The same against another state, each reading by itself.
    pub fn read_of(
        &self,
        plant: &Plant,
        beside: &DVector<f64>,
        linearised: Option<&LinearisedPlant>,
        to: &mut Readings,
    ) {
        to.clear();
        let (tracks, n) = (&self.case.tracks, self.layout.plant.size());
        let imu = if self.reads_imu() { plant.imu_reading() } else { Default::default() };
        for (position, sample) in &self.due {
            let track = &tracks[*position];
            if track.channel == Channel::Vector {
                self.read_direction(plant, *position, *sample, linearised.is_some(), to);
                continue;
            }
            for component in &track.components {
                let index = component.index();
                let Some(reading) = track.number(*sample, index) else { continue };
                let (predicted, bias) = match track.channel {
                    Channel::Gyro => (imu.0.get(index), self.layout.gyro_bias()),
                    Channel::Accelerometer => (imu.1.get(index), self.layout.force_bias()),
                    _ => (plant.state().wheel_speed_rad_s().get(index), 0..0),
                };
                let bias = (!bias.is_empty()).then_some(bias.start + index);
                let predicted = predicted.copied().unwrap_or(f64::NAN) + bias.map_or(0.0, |i| beside[i]);
                if let Some(linearised) = linearised {
                    let by_state = &mut to.by_state;
                    let mut set_row =
                        |row: usize| (0..n).for_each(|i| by_state.set(i, linearised.imu_by_state[(row, i)]));
                    match track.channel {
                        Channel::Gyro => set_row(index),
                        Channel::Accelerometer => {
                            set_row(3 + index);
                            let by_torque = linearised.force_by_torque.row(index);
                            for (k, i) in self.layout.disturbance().enumerate() {
                                by_state.set(i, by_torque[k % 3]);
                            }
                            for (i, wheel) in self.layout.motors().zip(self.case.model().wheels()) {
                                by_state.set(i, -by_torque.transpose().dot(&wheel.spin_axis_b));
                            }
                        }
                        _ => by_state.set(self.layout.plant.wheels().start + index, 1.0),
                    }
                    bias.into_iter().for_each(|i| by_state.set(i, 1.0));
                }
                let of = (*component, self.noise.of(*component).powi(2));
                to.push(of, (*position, *sample), (reading, reading - predicted), Vector3::zeros());
            }
        }
    }

    /// The angle from the predicted direction to the one that was read, about two axes across it.
    fn read_direction(
        &self,
        plant: &Plant,
        position: usize,
        sample: usize,
        has_derivatives: bool,
        to: &mut Readings,
    ) {
        let track = &self.case.tracks[position];
        let reference = self.case.recording.vectors.get(track.sensor).map(|vector| vector.reference_world);
        let Some((reading, reference)) = track.vector(sample).zip(reference) else { return };
        let sensor = plant.gyrostat().model().sensors.vector;
        let misalignment_rad = sensor.map_or(Vector3::zeros(), |v| v.misalignment_rad);
        let to_sensor = quaternion_exp(&misalignment_rad).inverse();
        let predicted = to_sensor * plant.state().q_world_body.inverse_transform_vector(&reference);
        let measured = unit_or(reading, Unit::new_unchecked(predicted));
        let across = predicted.cross(&measured);
        let sine = across.norm();
        let off = if sine > 0.0 { across * (sine.atan2(predicted.dot(&measured)) / sine) } else { across };
        let helper = if predicted.z.abs() > 0.7 { Vector3::x() } else { Vector3::z() };
        let first = unit_or(predicted.cross(&helper), Vector3::x_axis()).into_inner();
        for (component, axis) in track.components.iter().zip([first, predicted.cross(&first)]) {
            // A body turned by a sees the direction turned by -a.
            if has_derivatives {
                let by_turn = to_sensor.inverse() * axis;
                (0..3).for_each(|i| to.by_state.set(ROTATION.start + i, -by_turn[i]));
            }
            let of = (*component, self.noise.of(*component).powi(2));
            to.push(of, (position, sample), (f64::NAN, off.dot(&axis)), axis);
        }
    }
}
