//! The filter: what was read corrects what was predicted. Three recursions, each with a module of its own: the mean with its innovations, the
//! covariance with its gains, and how both change with the state at the start and with parameters.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use whorl_math::lanes::Gain;

use crate::columns::Columns;
use crate::gains::Gains;
use crate::innovations::Mean;
use crate::rows::Readings;
use crate::start::known_biases;
use crate::trail::Trail;
use crate::{Innovation, Noise, Prepared, Start};

/// A rate so many times as fast as any motion that was read, or as 1 rad/s, is lost: a start that was moved too far would be followed in steps of microseconds.
const LOST: f64 = 100.0;

pub(crate) struct Filter<'a> {
    pub mean: Mean<'a>,
    pub gains: Gains,
    /// How it changes with its state at an instant, and with parameters of the model.
    pub columns: Option<Columns<'a>>,
    pub trail: Option<Trail>,
    /// Its gains, instant by instant \[ns\], if they are kept for passes close by.
    pub kept: Option<Vec<(i64, Gain)>>,
    pub readings: Readings,
    /// Covariance of the start, how far from the start that was given the filter began,
    pub known: DMatrix<f64>,
    pub begun: DVector<f64>,
    /// and what of the logarithm of what was known before the run the innovations do not say.
    pub log_known: f64,
}

impl<'a> Filter<'a> {
    pub fn new(case: &'a Prepared<'a>, noise: &'a Noise, start: &Start) -> Self {
        let mean = Mean::new(case, noise, start);
        let gains = Gains::new(case, noise, start, &mean.plant);
        let size = start.layout.size();
        Self {
            columns: None,
            trail: None,
            kept: None,
            readings: Readings::default(),
            known: gains.covariance.matrix(size, size),
            begun: DVector::zeros(size),
            log_known: 0.0,
            mean,
            gains,
        }
    }

    /// The same of a start that moves from pass to pass: what was known of the sensors' biases before the run stays about none.
    pub fn about_known_biases(mut self, start: &Start) -> Self {
        let (begun, log_known) = begun_about_known_biases(self.mean.case, start, &self.known);
        self.mean.change(&begun);
        (self.begun, self.log_known) = (begun, log_known);
        self
    }

    pub fn run(&mut self, most: usize, told: &mut dyn FnMut(&Innovation)) -> Likelihood {
        let mut likelihood = Likelihood::begun(self.log_known);
        let mut add = |innovation: &Innovation| {
            likelihood.add(innovation);
            told(innovation);
        };
        let mut instants = 0..most;
        while instants.next().is_some() && self.step(&mut add) {}
        likelihood.end(&self.mean);
        likelihood
    }

    /// Goes to the next instant at which anything was read, and takes it in. False behind the last, and when the motion is lost.
    pub fn step(&mut self, told: &mut dyn FnMut(&Innovation)) -> bool {
        if !self.go() {
            return false;
        }
        self.read();
        self.take_in(told);
        !self.mean.lost
    }

    /// Goes to the next instant at which anything was read; false where there is none.
    pub fn go(&mut self) -> bool {
        let (mean, gains) = (&mut self.mean, &mut self.gains);
        let Some(to_ns) = mean.set_out() else { return false };
        let case = mean.case;
        while mean.plant.now_ns() < to_ns && !mean.lost {
            if mean.plant.state().omega_wb_b_rad_s.norm() > LOST * case.fastest_1_s.max(1.0) {
                mean.lost = true;
                break;
            }
            let from_ns = mean.plant.now_ns();
            let left_ns = to_ns - from_ns;
            // Equal steps, so that none is tiny, and not twice as many for what rounding makes longer.
            let steps = (left_ns as f64 * 1e-9 / gains.longest_s() - 1e-6).ceil().clamp(1.0, 1e6);
            let end_ns = (from_ns + ((left_ns as f64 / steps).ceil() as i64).max(1)).min(to_ns);
            mean.disturb();
            self.columns.iter_mut().for_each(|columns| columns.set_out(mean, end_ns, to_ns));
            mean.advance(end_ns);
            gains.follow(&mean.plant, end_ns - from_ns);
            if let Some(columns) = &mut self.columns {
                mean.lost |= !columns.follow(case, &mean.plant, gains);
            }
            self.trail.iter_mut().for_each(|trail| trail.step(end_ns - from_ns, gains));
        }
        // Nothing is uncertain of a wheel that its friction holds.
        for (i, _) in mean.layout.plant.wheels().zip(mean.plant.held_wheels()).filter(|(_, held)| *held) {
            gains.hold(i);
            self.columns.iter_mut().for_each(|columns| columns.blocks.hold(i));
            self.trail.iter_mut().for_each(|trail| trail.hold(i));
        }
        mean.find_due(to_ns);
        !mean.lost
    }

    pub fn read(&mut self) {
        self.mean.read(Some(&self.gains.linearised), &mut self.readings);
        self.gains.set_back(&mut self.readings);
    }

    pub fn take_in(&mut self, told: &mut dyn FnMut(&Innovation)) {
        let (mean, gains) = (&mut self.mean, &mut self.gains);
        if let Some(columns) = &mut self.columns {
            columns.read(mean, &gains.linearised, &self.readings);
            columns.blocks.set_back(&self.readings);
        }
        // Every reading has noise: without a variance the covariance is beyond repair.
        if !gains.correct(&self.readings) {
            mean.lost = true;
            return;
        }
        mean.take_in(&self.readings, &gains.gain, told);
        if let Some(columns) = &mut self.columns {
            columns.blocks.take_in(&self.readings.by_state, &gains.gain, &mean.values);
        }
        if mean.lost {
            return;
        }
        self.trail.iter_mut().for_each(|trail| trail.take_in(&self.readings, &gains.gain, &mean.values));
        self.kept.iter_mut().for_each(|kept| kept.push((mean.plant.now_ns(), gains.gain.clone())));
    }
}

/// How far from its start a filter begins so that what was known of biases before the run stays about none, and what that adds to log p (METHOD.md, "Start").
pub(crate) fn begun_about_known_biases(
    case: &Prepared<'_>,
    start: &Start,
    known: &DMatrix<f64>,
) -> (DVector<f64>, f64) {
    let mut pull = DVector::zeros(start.layout.size());
    for (i, stddev) in known_biases(case, start.layout).filter(|(_, stddev)| *stddev > 0.0) {
        pull[i] = -start.beside[i] / (stddev * stddev);
    }
    let begun = known * &pull;
    let log_known = 0.5 * (pull.dot(&start.beside) + pull.dot(&begun));
    (begun, log_known)
}

/// Share by which a variance of readings that was found with another model may be off: levels beside random torques are known to some per cent.
const UNSURE_OF_NOISE: f64 = 0.1;

/// Sums over all innovations of a recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Likelihood {
    /// log p of all readings given the commands, -1/2 sum(e^2/S + log 2 pi S).
    pub log: f64,
    /// Sum of squares of the normalised innovations.
    pub chi_squared: f64,
    /// How many numbers were read.
    pub numbers: usize,
    /// The motion was lost before the end: a parameter is too extreme.
    pub lost: bool,
}

impl Likelihood {
    /// Mean square of the normalised innovations: 1 with the true model.
    pub fn misfit(&self) -> f64 {
        self.chi_squared / self.numbers.max(1) as f64
    }

    /// Whether no more than noise is left: the misfit is 1 to five deviations of such a mean, and to what a level of noise may be off by.
    pub(crate) fn is_noise(&self) -> bool {
        self.misfit() < 1.0 + UNSURE_OF_NOISE + 5.0 * (2.0 / self.numbers.max(1) as f64).sqrt()
    }

    /// Of no readings yet; `log_known`: what they do not say of it.
    pub(crate) fn begun(log_known: f64) -> Self {
        Self { log: log_known, ..Self::default() }
    }

    pub(crate) fn add(&mut self, innovation: &Innovation) {
        self.log += innovation.log_likelihood();
        self.chi_squared += innovation.normalised().powi(2);
        self.numbers += 1;
    }

    /// Behind the last, with what readings of cells are more than their means; what is lost is not likely at all.
    pub(crate) fn end(&mut self, mean: &Mean<'_>) {
        self.log += mean.apart.log();
        self.lost = mean.lost || !self.log.is_finite();
        if self.lost {
            self.lose();
        }
    }

    pub(crate) fn lose(&mut self) {
        (self.lost, self.log) = (true, f64::NEG_INFINITY);
    }
}
