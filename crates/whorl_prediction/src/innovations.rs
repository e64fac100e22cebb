//! The mean of a state on its way through a recording, and what readings are less their predictions: with any gains.

use std::cell::Cell;

use nalgebra::{DVector, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, ROTATION};
use whorl_math::lanes::{Gain, Sparse, level};
use whorl_recording::Component;

use crate::noise::{Layout, Noise};
use crate::prepared::Prepared;
use crate::readings::Cursor;
use crate::rows::{Collected, Readings, Seen};
use crate::start::Start;
use crate::stop::obey;

thread_local! {
    static INSTANTS: Cell<u64> = const { Cell::new(0) };
}

/// Instants of recordings at which anything was taken in on this thread since it began, whatever for: over those of a recording, how many passes by each
/// reading a computation was worth, on any machine.
#[must_use]
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
    #[must_use]
    pub fn normalised(&self) -> f64 {
        self.value / self.stddev
    }

    /// Its part of the log likelihood, -1/2 (e^2/S + log 2 pi S).
    #[must_use]
    pub fn log_likelihood(&self) -> f64 {
        -0.5 * (self.normalised().powi(2) + (std::f64::consts::TAU * self.stddev * self.stddev).ln())
    }
}

/// The mean of the state on its way.
pub(crate) struct Mean<'a> {
    pub case: &'a Prepared<'a>,
    pub noise: &'a Noise,
    pub layout: Layout,
    pub plant: Plant,
    /// Disturbance and biases: what the state has besides the plant's, by [`Layout`]; entries of the plant are zero.
    pub beside: DVector<f64>,
    /// The next command.
    pub event: usize,
    cursor: Cursor,
    /// Where the present cell of readings ends \[ns\], and what was read in it.
    end_ns: i64,
    collected: Collected,
    /// Readings of an instant within a cell.
    within: Readings,
    /// Motors' disturbances at the start of a step, and what they have moved within it.
    motors_n_m: Vec<f64>,
    moved: Vec<f64>,
    /// What was read at the present instant: tracks and samples.
    pub due: Vec<(usize, usize)>,
    /// Innovations of the present instant.
    pub values: Vec<f64>,
    /// By how much they change the state.
    change: Vec<f64>,
    /// The motion is no longer finite.
    pub lost: bool,
}

impl<'a> Mean<'a> {
    /// At a start.
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
            within: Readings::default(),
            motors_n_m: Vec::new(),
            moved: Vec::new(),
            due: Vec::new(),
            values: Vec::new(),
            change: Vec::new(),
            lost: false,
        }
    }

    /// The instant at which the next readings are taken in \[ns\].
    pub fn next_ns(&self) -> Option<i64> {
        self.cursor.instant_ns(&self.case.tracks).map(|first_ns| self.case.cell_end_ns(first_ns))
    }

    /// Sets out to the instant of the next readings. What is read then is known before: what a platform does there is what others begin
    /// with.
    pub fn set_out(&mut self, instant_ns: i64) {
        self.end_ns = instant_ns;
        self.collected.clear();
        self.plant.average_readings(self.case.mean_inputs(instant_ns));
    }

    /// A step of the plant to an instant, with the disturbances that are known now; `before`: what a step did to errors before this one, and its length
    /// \[s\], by which what motors have moved is told where something is read within.
    pub fn advance(&mut self, end_ns: i64, before: Option<(&Sparse, f64)>) {
        let motors = self.layout.motors();
        self.motors_n_m.clear();
        self.motors_n_m.extend(motors.map(|i| self.beside[i]));
        self.moved.clear();
        self.moved.resize(self.layout.plant.size(), 0.0);
        let from_ns = self.plant.now_ns();
        while let Some(instant_ns) = self.cursor.instant_ns(&self.case.tracks)
            && instant_ns < self.end_ns
            && instant_ns <= end_ns
            && !self.lost
        {
            self.plant.average_readings(self.case.mean_inputs(instant_ns));
            self.go(instant_ns);
            if let Some((transition, step_s)) = before {
                self.move_by_motors(transition, (instant_ns - from_ns) as f64 * 1e-9 / step_s, None);
            }
            self.collect(instant_ns);
            self.plant.average_readings(self.case.mean_inputs(self.end_ns));
        }
        self.go(end_ns);
    }

    /// Moves the plant to an instant, while disturbances fade.
    fn go(&mut self, to_ns: i64) {
        let (torques, noise) = (self.layout.disturbance(), &self.noise.disturbance);
        for (k, process) in noise.processes().enumerate().take(torques.len() / 3) {
            let now_n_m = Vector3::from_fn(|i, _| self.beside[torques.start + 3 * k + i]);
            self.plant.set_disturbance(k, now_n_m, 1.0 / process.correlation_s);
        }
        let from_ns = self.plant.now_ns();
        self.lost |= !self.case.commands.run_to(&mut self.plant, &mut self.event, to_ns);
        let after_s = (to_ns - from_ns) as f64 * 1e-9;
        for (i, _, correlation_s) in noise.coordinates(self.layout) {
            self.beside[i] *= (-after_s / correlation_s).exp();
        }
    }

    /// Moves the plant by what the motors' disturbances, which it does not know, have moved over this share of a step, by their columns of F.
    pub fn move_by_motors(&mut self, transition: &Sparse, share: f64, heading: Option<&Vector3<f64>>) {
        let (motors, n) = (self.layout.motors(), self.layout.plant.size());
        if motors.is_empty() {
            return;
        }
        self.change.clear();
        self.change.extend(self.moved.iter().map(|moved| -moved));
        for (i, k, by) in transition.entries().filter(|(i, k, _)| *i < n && motors.contains(k)) {
            self.change[i] += by * self.motors_n_m[k - motors.start] * share;
        }
        self.moved.iter_mut().zip(&self.change).for_each(|(sum, by)| *sum += by);
        if let Some(axis) = heading {
            level(&mut self.change[ROTATION], axis);
        }
        self.plant.change_state(&self.change);
    }

    /// Finds what is taken in at the present instant.
    pub fn find_due(&mut self, instant_ns: i64) {
        INSTANTS.set(INSTANTS.get() + 1);
        obey();
        if self.collected.is_empty() {
            self.find_due_now(instant_ns);
            return;
        }
        self.collect(instant_ns);
        self.collected.last(&mut self.due);
    }

    fn find_due_now(&mut self, instant_ns: i64) {
        let tracks = &self.case.tracks;
        self.due.clear();
        while let Some(reading) = self.cursor.take(tracks, instant_ns) {
            self.due.push(reading);
        }
    }

    /// Reads what is due within a cell.
    fn collect(&mut self, instant_ns: i64) {
        self.find_due_now(instant_ns);
        let mut within = std::mem::take(&mut self.within);
        self.read_of(&self.plant, self.beside.as_slice(), None, &mut within);
        self.collected.add(&within, (self.end_ns - instant_ns) as f64 * 1e-9);
        self.within = within;
    }

    /// Reads what is due against this state.
    pub fn read(&self, linearised: Option<&LinearisedPlant>, to: &mut Readings) {
        self.read_of(&self.plant, self.beside.as_slice(), linearised, to);
        self.collected.put(to);
    }

    /// The same against another state.
    pub fn read_of(
        &self,
        plant: &Plant,
        beside: &[f64],
        linearised: Option<&LinearisedPlant>,
        to: &mut Readings,
    ) {
        let Self { case, noise, layout, due, .. } = self;
        Seen { case, noise, layout: *layout, plant, beside, linearised }.read(due, to);
    }

    /// Corrects the state by readings, one number after the other.
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

    /// Moves the state.
    pub fn change(&mut self, change: &DVector<f64>) {
        self.change.clear();
        self.change.extend(change.iter());
        self.apply_change();
    }

    fn apply_change(&mut self) {
        let n = self.layout.plant.size();
        for i in n..self.layout.size() {
            self.beside[i] += self.change[i];
        }
        self.plant.change_state(&self.change[..n]);
    }
}
