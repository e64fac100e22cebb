//! The filter: what was read corrects what was predicted.

use nalgebra::{DMatrix, DVector, DVectorView};
use whorl_dynamics::plant::{LinearisedPlant, Plant};
use whorl_math::covariance;
use whorl_recording::Component;

use crate::claims::Claims;
use crate::columns::Columns;
use crate::guess::known_biases;
use crate::heading::UnseenHeading;
use crate::information::Information;
use crate::layout::Layout;
use crate::linearisation::{Place, linearised};
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::readings::Cursor;
use crate::rows::{Row, Seen, Taken};
use crate::since::Since;
use crate::start::Start;
use crate::transition::{Step, fastest_rate_1_s};

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
    pub covariance: DMatrix<f64>,
    /// Of the start itself before anything was read,
    before: DMatrix<f64>,
    /// and by how much it has become less.
    learnt: Information,
    /// How far it is from the start that was given.
    pub shift: DVector<f64>,
}

impl Origin {
    /// The start's covariance given what was read, and how far it is from where the filter began.
    pub fn end(self) -> (DMatrix<f64>, DVector<f64>) {
        (self.before - self.learnt.sum(), self.shift)
    }
}

/// A filter on its way through a recording.
pub(crate) struct Filter<'a> {
    pub(super) case: &'a Prepared<'a>,
    pub(super) noise: &'a Noise,
    pub layout: Layout,
    pub plant: Plant,
    /// Disturbance and biases: what the state has besides the plant's, by [`Layout`]; entries of the plant are zero.
    pub beside: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// What predictions ahead need.
    pub claims: Option<Claims>,
    /// How it changes with parameters of the model.
    pub columns: Option<Columns<'a>>,
    pub(super) linearised: LinearisedPlant,
    /// Where the derivatives were made.
    pub(super) place: Place,
    pub(super) fastest_1_s: f64,
    /// What a step of this length does to errors with the present derivatives.
    pub(super) over_step: Option<(i64, Step)>,
    /// The next command.
    pub event: usize,
    cursor: Cursor,
    pub origin: Option<Origin>,
    /// How far from the start that was given the filter began,
    begun: DVector<f64>,
    /// and what of the logarithm of what was known before the run the innovations do not say.
    pub log_known: f64,
    /// What the readings since an instant say of the state there.
    pub since: Option<Since>,
    /// What of the attitude at the start is of no consequence.
    pub heading: UnseenHeading,
    /// The motion is no longer finite.
    pub lost: bool,
}

impl<'a> Filter<'a> {
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start) -> Self {
        let mut plant = case.plant().clone();
        start.put(&mut plant);
        let event = case.first_event();
        let linearised = linearised(&plant, noise.disturbance.is_some() || case.drives_with_noise());
        let heading = UnseenHeading::of(case, &plant, &linearised);
        let layout = start.layout;
        let mut filter = Self {
            case,
            noise,
            layout,
            fastest_1_s: 0.0,
            beside: start.beside.clone(),
            covariance: heading.out_of(&start.covariance),
            claims: None,
            columns: None,
            linearised,
            place: Place::of(&plant),
            over_step: None,
            heading,
            plant,
            event,
            cursor: Cursor::new(case.tracks()),
            origin: None,
            begun: DVector::zeros(layout.size()),
            log_known: 0.0,
            since: None,
            lost: false,
        };
        filter.fastest_1_s = fastest_rate_1_s(&filter.motion());
        filter
    }

    /// The same of a start that moves from pass to pass: what was known of the sensors' biases before the run stays about none. With b
    /// the start's biases, B the variances known of them and P the start's covariance, in which B is a part of the information,
    ///
    /// ```text
    /// start' = start - P B^-1 b        log p' = log p - b B^-1 b/2 + b B^-1 P B^-1 b/2
    /// ```
    ///
    /// Otherwise pass after pass would move the biases as if nothing were known of them, against a tilt that looks the same.
    pub fn about_known_biases(mut self, start: &Start) -> Self {
        let mut pull = DVector::zeros(self.layout.size());
        for (i, stddev) in known_biases(self.case, self.layout).filter(|(_, stddev)| *stddev > 0.0) {
            pull[i] = -start.beside[i] / (stddev * stddev);
        }
        self.begun = &self.covariance * &pull;
        self.log_known = 0.5 * (pull.dot(&start.beside) + pull.dot(&self.begun));
        let begun = self.begun.clone();
        self.change(begun.as_view());
        self
    }

    /// The same, which learns of its start as it goes.
    pub fn looking_back(mut self) -> Self {
        let p = &self.covariance;
        let learnt = Information::new(p.nrows(), 0, 0);
        let shift = self.begun.clone();
        self.origin = Some(Origin { covariance: p.clone(), before: p.clone(), learnt, shift });
        self
    }

    /// The same from which predictions ahead begin.
    pub fn claiming(mut self) -> Self {
        self.claims = Some(Claims::new(&self.covariance, self.layout, self.has_own_noise()));
        self
    }

    /// The same, which finds how it changes with parameters.
    pub fn varying(mut self, columns: Columns<'a>) -> Self {
        if columns.has_laws() {
            self.plant.linearise_torque(&mut self.linearised);
        }
        self.columns = Some(columns);
        self
    }

    /// Whether derivatives by a torque are needed: of disturbances, of laws, or of wheels that are driven along their speeds.
    pub(super) fn has_torques(&self) -> bool {
        self.noise.disturbance.is_some()
            || self.case.drives_with_noise()
            || self.columns.as_ref().is_some_and(Columns::has_laws)
    }

    /// What the model alone claims to know now, without disturbances.
    pub fn claimed(&self) -> &DMatrix<f64> {
        self.claims.as_ref().and_then(|claims| claims.covariance.as_ref()).unwrap_or(&self.covariance)
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
            let mut columns = self.columns.take();
            let direct = columns.as_mut().map(|columns| {
                let read = |plant: &Plant| self.values_of(plant, &due);
                columns.of_readings(&self.plant, &self.linearised, &rows, &read)
            });
            self.columns = columns;
            self.take_in(&rows, direct, told);
            !self.lost
        })
    }

    /// Goes to the next instant at which anything was read.
    pub fn go(&mut self) -> Option<i64> {
        let instant_ns = self.next_ns()?;
        // What is read then is known before: what a platform does there is what others begin with.
        self.plant.average_readings(self.case.mean_inputs(instant_ns));
        self.propagate(instant_ns);
        (!self.lost).then_some(instant_ns)
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
        self.seen(plant, beside, true).rows(due)
    }

    /// What they are less their predictions with another model in the present state; without derivatives.
    pub fn values_of(&self, plant: &Plant, due: &[(usize, usize)]) -> Vec<Row> {
        self.seen(plant, &self.beside, false).rows(due)
    }

    fn seen<'b>(&'b self, plant: &'b Plant, beside: &'b DVector<f64>, with_derivatives: bool) -> Seen<'b> {
        Seen {
            case: self.case,
            noise: self.noise,
            layout: self.layout,
            plant,
            beside,
            linearised: with_derivatives.then_some(&self.linearised),
        }
    }

    /// Corrects the state by these readings, one number after the other; `direct` is how they change with the parameters where the
    /// state does not.
    pub fn take_in(&mut self, rows: &[Row], direct: Option<DMatrix<f64>>, told: &mut dyn FnMut(&Innovation)) {
        let time_s = self.plant.now_ns() as f64 * 1e-9;
        let size = self.layout.size();
        let mut change = DVector::zeros(size);
        let mut taken = Taken::new(size, rows.len(), self.origin.as_ref().map(|o| o.covariance.nrows()));
        for (k, row) in rows.iter().enumerate() {
            let a = product(&self.covariance, &row.by_state);
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
            if let Some(claimed) = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut()) {
                let a = product(claimed, &row.by_state);
                let s = row.by_state.dot(&a) + row.variance;
                covariance::correct_scalar(claimed, &a, s);
            }
            change.axpy(value, &gain, 1.0);
            if let Some(since) = &mut self.since {
                since.learn(&row.by_state, value, s, &gain);
            }
            if let Some((origin, mut gain_of_start)) =
                self.origin.as_mut().zip(taken.of_start.as_mut().map(|all| all.column_mut(k)))
            {
                let b = product(&origin.covariance, &row.by_state);
                origin.covariance.ger(-1.0 / s, &b, &a, 1.0);
                origin.learnt.add(b.as_view(), s);
                gain_of_start.axpy(1.0 / s, &b, 0.0);
                origin.shift.axpy(value, &gain_of_start, 1.0);
            }
            taken.add(value, s, &gain);
        }
        covariance::symmetrise(&mut self.covariance);
        if let Some(claimed) = self.claims.as_mut().and_then(|claims| claims.covariance.as_mut()) {
            covariance::symmetrise(claimed);
        }
        self.change(change.as_view());
        if let Some((columns, direct)) = self.columns.as_mut().zip(direct) {
            columns.take_in(rows, direct, &taken);
        }
    }

    fn change(&mut self, change: DVectorView<'_, f64>) {
        let n = self.layout.plant.size();
        for i in n..self.layout.size() {
            self.beside[i] += change[i];
        }
        self.plant.change_state(&change.as_slice()[..n]);
    }
}

/// A matrix times a vector most of whose entries are zero.
pub(crate) fn product(matrix: &DMatrix<f64>, sparse: &DVector<f64>) -> DVector<f64> {
    let mut product = DVector::zeros(matrix.nrows());
    for (column, x) in matrix.column_iter().zip(sparse).filter(|(_, x)| **x != 0.0) {
        product.axpy(*x, &column, 1.0);
    }
    product
}
