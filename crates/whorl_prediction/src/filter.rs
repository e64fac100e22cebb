//! The filter: the plant carries the mean from stamp to stamp, its linearisation the covariance.

use nalgebra::{DMatrix, DVector, DVectorView, Vector3};
use whorl_dynamics::plant::{LinearisedPlant, Plant, RATE, ROTATION};
use whorl_math::covariance;
use whorl_recording::Component;

use crate::layout::Layout;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::readings::Cursor;
use crate::rows::{Row, Seen};
use crate::start::Start;
use crate::transition::{Step, fastest_rate_1_s, step};

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

/// How the state at the start covaries with that at the present, and what has been learnt of it.
pub(crate) struct Origin {
    /// Start by present.
    covariance: DMatrix<f64>,
    /// Of the start itself.
    pub own: DMatrix<f64>,
    /// How far it is from where the filter began.
    pub shift: DVector<f64>,
}

/// A filter on its way through a recording.
pub(crate) struct Filter<'a> {
    case: &'a Prepared<'a>,
    noise: &'a Noise,
    pub layout: Layout,
    pub plant: Plant,
    /// Disturbance and biases: what the state has besides the plant's, by [`Layout`]; entries of the plant are zero.
    pub beside: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// Motion of the error over the last step, as far as it moves.
    pub transition: DMatrix<f64>,
    linearised: LinearisedPlant,
    /// When the derivatives were made, and which wheels were held.
    linearised_ns: i64,
    held: u64,
    /// How far corrections have moved the state since.
    corrected_rad: f64,
    fastest_1_s: f64,
    /// What a step of this length does to errors with the present derivatives.
    over_step: Option<(i64, Step)>,
    /// The next command.
    pub event: usize,
    cursor: Cursor,
    pub origin: Option<Origin>,
    /// The motion is no longer finite.
    pub lost: bool,
}

impl<'a> Filter<'a> {
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start) -> Self {
        let mut plant = case.plant().clone();
        start.put(&mut plant);
        let event = case.first_event();
        let linearised = linearised(&plant, noise);
        let layout = start.layout;
        let mut filter = Self {
            case,
            noise,
            layout,
            fastest_1_s: 0.0,
            beside: start.beside.clone(),
            covariance: start.covariance.clone(),
            transition: DMatrix::identity(layout.moving(), layout.moving()),
            linearised,
            linearised_ns: plant.now_ns(),
            held: 0,
            corrected_rad: 0.0,
            over_step: None,
            plant,
            event,
            cursor: Cursor::new(case.tracks()),
            origin: None,
            lost: false,
        };
        filter.fastest_1_s = fastest_rate_1_s(&filter.motion());
        filter
    }

    /// The same, which learns of its start as it goes.
    pub fn looking_back(mut self) -> Self {
        let p = &self.covariance;
        self.origin =
            Some(Origin { covariance: p.clone(), own: p.clone(), shift: DVector::zeros(p.nrows()) });
        self
    }

    /// The instant of the next readings \[ns\].
    pub fn next_ns(&self) -> Option<i64> {
        self.cursor.instant_ns(self.case.tracks())
    }

    /// Goes to the next instant at which anything was read, and takes it in: `told` hears what was found. False behind the
    /// last, and when the motion is lost.
    pub fn step(&mut self, told: &mut dyn FnMut(&Innovation)) -> bool {
        self.go().is_some_and(|instant_ns| {
            let due = self.due(instant_ns);
            let rows = self.rows(&due);
            self.take_in(&rows, told);
            !self.lost
        })
    }

    /// Goes to the next instant at which anything was read.
    pub fn go(&mut self) -> Option<i64> {
        let instant_ns = self.next_ns()?;
        self.propagate(instant_ns);
        (!self.lost).then_some(instant_ns)
    }

    /// d/dt of the error of what moves.
    fn motion(&self) -> DMatrix<f64> {
        let (n, size) = (self.layout.plant.size(), self.layout.moving());
        let mut a = DMatrix::zeros(size, size);
        a.view_mut((0, 0), (n, n)).copy_from(&self.linearised.rate_by_state);
        let torque = self.layout.disturbance();
        if !torque.is_empty() {
            a.view_mut((0, torque.start), (n, 3)).copy_from(&self.linearised.rate_by_torque);
            for i in torque {
                a[(i, i)] = -1.0 / self.noise.disturbance.correlation_s;
            }
        }
        a
    }

    fn propagate(&mut self, to_ns: i64) {
        self.transition.fill_with_identity();
        while self.plant.now_ns() < to_ns && !self.lost {
            let from_ns = self.plant.now_ns();
            let longest_s = self.case.settings().covariance_step / self.fastest_1_s.max(1e-9);
            let left_ns = to_ns - from_ns;
            // Equal steps, so that none is tiny.
            let steps = (left_ns as f64 * 1e-9 / longest_s).ceil().clamp(1.0, 1e6);
            let end_ns = from_ns + ((left_ns as f64 / steps).ceil() as i64).max(1);
            let end_ns = end_ns.min(to_ns);
            self.show_disturbance();
            self.lost = !self.case.run_to(&mut self.plant, &mut self.event, end_ns);
            let h_s = (end_ns - from_ns) as f64 * 1e-9;
            let step = self.errors_over(end_ns - from_ns);
            self.grow(&step, h_s);
            for i in self.layout.disturbance() {
                self.beside[i] *= (-h_s / self.noise.disturbance.correlation_s).exp();
            }
            self.transition = &step.transition * &self.transition;
        }
        self.hold_wheels();
    }

    /// What the step that ends now does to errors. Derivatives are held while the motion has hardly gone on since they were
    /// made, and with them what equal steps do.
    fn errors_over(&mut self, step_ns: i64) -> Step {
        let age_s = (self.plant.now_ns() - self.linearised_ns) as f64 * 1e-9;
        let held = self.plant.held_wheels().fold(0, |bits: u64, held| bits << 1 | u64::from(held));
        let (before, step_s) = (self.motion(), step_ns as f64 * 1e-9);
        if age_s * self.fastest_1_s + self.corrected_rad > self.case.settings().derivatives_held
            || held != self.held
        {
            self.linearised = linearised(&self.plant, self.noise);
            (self.linearised_ns, self.held, self.corrected_rad) = (self.plant.now_ns(), held, 0.0);
            let after = self.motion();
            self.fastest_1_s = fastest_rate_1_s(&after);
            self.over_step = None;
            return step(&((before + after) * 0.5), &self.density(), step_s);
        }
        if let Some((_, step)) = self.over_step.as_ref().filter(|(of_ns, _)| *of_ns == step_ns) {
            return step.clone();
        }
        let step = step(&before, &self.density(), step_s);
        self.over_step = Some((step_ns, step.clone()));
        step
    }

    /// Densities of the white noise that drives what moves, by coordinate [unit^2/s].
    fn density(&self) -> DVector<f64> {
        let mut density = DVector::from_fn(self.layout.moving(), |i, _| self.walk_variance(i, 1.0));
        let of = &self.noise.disturbance;
        for (i, stddev) in self.layout.disturbance().zip(of.stddev_b_n_m) {
            density[i] = 2.0 * stddev * stddev / of.correlation_s;
        }
        density
    }

    fn show_disturbance(&mut self) {
        let torque = self.layout.disturbance();
        if !torque.is_empty() {
            let now_n_m = Vector3::from_fn(|i, _| self.beside[torque.start + i]);
            self.plant.set_disturbance(now_n_m, 1.0 / self.noise.disturbance.correlation_s);
        }
    }

    /// P <- F P F^T + Q, of what moves; the rest walks.
    fn grow(&mut self, step: &Step, h_s: f64) {
        let phi = &step.transition;
        let (m, n) = (phi.nrows(), self.layout.size());
        let moved = phi * self.covariance.rows(0, m);
        let mut within = moved.columns(0, m) * phi.transpose();
        if let Some(noise) = &step.noise {
            within += noise;
        }
        self.covariance.view_mut((0, 0), (m, m)).copy_from(&within);
        if n > m {
            self.covariance.view_mut((0, m), (m, n - m)).copy_from(&moved.columns(m, n - m));
            self.covariance.view_mut((m, 0), (n - m, m)).copy_from(&moved.columns(m, n - m).transpose());
        }
        for i in m..n {
            self.covariance[(i, i)] += self.walk_variance(i, h_s);
        }
        if let Some(origin) = &mut self.origin {
            let moved = origin.covariance.columns(0, m) * phi.transpose();
            origin.covariance.columns_mut(0, m).copy_from(&moved);
        }
    }

    /// Variance that a coordinate gains by its own random walk in this time \[s\].
    pub fn walk_variance(&self, i: usize, after_s: f64) -> f64 {
        let (layout, sensors) = (self.layout, &self.case.model().sensors);
        let of = |walk: Option<f64>| walk.unwrap_or(0.0).powi(2) * after_s;
        if layout.plant.hidden().contains(&i) {
            return of(self.case.hidden_noise().nth(i - layout.plant.hidden().start));
        }
        if layout.gyro_bias().contains(&i) {
            return of(sensors.gyro.errors.bias_walk.get(i - layout.gyro_bias().start).copied());
        }
        if layout.force_bias().contains(&i) {
            return of(sensors.accelerometer.errors.bias_walk.get(i - layout.force_bias().start).copied());
        }
        0.0
    }

    /// Nothing is uncertain of a wheel that its friction holds.
    fn hold_wheels(&mut self) {
        let held: Vec<usize> = self
            .layout
            .plant
            .wheels()
            .zip(self.plant.held_wheels())
            .filter_map(|(i, held)| held.then_some(i))
            .collect();
        for i in held {
            self.covariance.row_mut(i).fill(0.0);
            self.covariance.column_mut(i).fill(0.0);
            if let Some(origin) = &mut self.origin {
                origin.covariance.column_mut(i).fill(0.0);
            }
        }
    }

    /// What was read at the present instant: tracks and samples.
    pub fn due(&mut self, instant_ns: i64) -> Vec<(usize, usize)> {
        let tracks = self.case.tracks();
        std::iter::from_fn(|| self.cursor.take(tracks, instant_ns)).collect()
    }

    /// What these readings show of the state.
    pub fn rows(&self, due: &[(usize, usize)]) -> Vec<Row> {
        self.rows_of(&self.plant, &self.beside, due)
    }

    /// What the same readings show of another state close by.
    pub fn rows_of(&self, plant: &Plant, beside: &DVector<f64>, due: &[(usize, usize)]) -> Vec<Row> {
        let seen = Seen {
            case: self.case,
            noise: self.noise,
            layout: self.layout,
            plant,
            beside,
            linearised: &self.linearised,
        };
        seen.rows(due)
    }

    /// Corrects the state by these readings, one number after the other.
    pub fn take_in(&mut self, rows: &[Row], told: &mut dyn FnMut(&Innovation)) {
        let time_s = self.plant.now_ns() as f64 * 1e-9;
        let mut change = DVector::zeros(self.layout.size());
        for row in rows {
            let a = &self.covariance * &row.by_state;
            let s = row.by_state.dot(&a) + row.variance;
            let value = row.value - row.by_state.dot(&change);
            // Every reading has noise: without a variance the covariance is beyond repair, without a value the motion.
            if !(s > 0.0 && s.is_finite() && value.is_finite()) {
                self.lost = true;
                return;
            }
            told(&Innovation {
                time_s,
                component: row.component,
                sample: row.sample,
                value,
                stddev: s.sqrt(),
            });
            let gain = covariance::correct_scalar(&mut self.covariance, &a, s);
            change.axpy(value, &gain, 1.0);
            if let Some(origin) = &mut self.origin {
                let b = &origin.covariance * &row.by_state;
                origin.shift.axpy(value / s, &b, 1.0);
                origin.own.ger(-1.0 / s, &b, &b, 1.0);
                origin.covariance.ger(-1.0 / s, &b, &a, 1.0);
            }
        }
        covariance::symmetrise(&mut self.covariance);
        self.change(change.as_view());
    }

    fn change(&mut self, change: DVectorView<'_, f64>) {
        let n = self.layout.plant.size();
        for i in n..self.layout.size() {
            self.beside[i] += change[i];
        }
        self.plant.change_state(&change.as_slice()[..n]);
        // A correction moves the state away from where the derivatives were made, as motion does.
        let of = |range: std::ops::Range<usize>| change.rows(range.start, range.len()).norm();
        self.corrected_rad += of(ROTATION) + of(RATE) / self.fastest_1_s.max(1.0);
    }
}

fn linearised(plant: &Plant, noise: &Noise) -> LinearisedPlant {
    let mut linearised = plant.linearised();
    if noise.disturbance.is_some() {
        plant.linearise_torque(&mut linearised);
    }
    linearised
}
