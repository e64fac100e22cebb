//! The filter: what was read corrects what was predicted.
//!
//! Three recursions, each with a module of its own: the mean with its innovations, the covariance with its gains, and how both change with
//! the state at the start and with parameters.

use nalgebra::{DMatrix, DVector};

use crate::claims::Claims;
use crate::columns::Columns;
use crate::gains::Gains;
use crate::guess::known_biases;
use crate::innovations::{Innovation, Mean};
use crate::kept_gains::Recorder;
use crate::levels::Trail;
use crate::noise::Noise;
use crate::prepared::Prepared;
use crate::rows::Readings;
use crate::start::Start;

/// A filter on its way through a recording.
pub(crate) struct Filter<'a> {
    pub mean: Mean<'a>,
    pub gains: Gains<'a>,
    /// How it changes with its state at an instant, and with parameters of the model.
    pub columns: Option<Columns<'a>>,
    /// Keeps gains for passes that take them as they are.
    pub recorder: Option<Recorder>,
    /// Keeps the way, so that one can go back along it.
    pub trail: Option<Trail>,
    /// Of the present instant.
    pub readings: Readings,
    /// Covariance of the start, how far from the start that was given the filter began,
    known: DMatrix<f64>,
    begun: DVector<f64>,
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
            recorder: None,
            trail: None,
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

    /// The same from which predictions ahead begin.
    pub fn claiming(mut self) -> Self {
        let has_own_noise = self.has_own_noise();
        self.gains.claims = Some(Claims::new(&self.gains.covariance, self.mean.layout, has_own_noise));
        self
    }

    /// The same, which finds how it changes with its start and with parameters.
    pub fn varying(mut self, columns: Columns<'a>) -> Self {
        if columns.has_torques() {
            self.gains.with_torques(&self.mean.plant);
        }
        self.columns = Some(columns);
        self
    }

    /// Whether the motion is lost.
    pub fn is_lost(&self) -> bool {
        self.mean.lost
    }

    /// Covariance of the start, and how far from the start that was given the filter began.
    pub fn begun(&self) -> (&DMatrix<f64>, &DVector<f64>) {
        (&self.known, &self.begun)
    }

    /// What the model alone claims to know now, without disturbances.
    pub fn claimed(&self) -> DMatrix<f64> {
        let claimed = self.gains.claims.as_ref().and_then(|claims| claims.covariance.as_ref());
        let size = self.mean.layout.size();
        claimed.unwrap_or(&self.gains.covariance).matrix(size, size)
    }

    /// Whether anything random moves besides disturbances.
    pub fn has_own_noise(&self) -> bool {
        let case = self.mean.case;
        case.hidden_noise().any(|level| level > 0.0) || case.drives_with_noise()
    }

    /// Goes to the next instant at which anything was read, and takes it in: `told` hears what was found. False behind the
    /// last, and when the motion is lost.
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
        let Some(instant_ns) = self.mean.next_ns() else { return false };
        self.mean.set_out(instant_ns);
        self.propagate(instant_ns);
        self.mean.find_due(instant_ns);
        !self.mean.lost
    }

    /// Reads what is due.
    pub fn read(&mut self) {
        self.mean.read(Some(&self.gains.linearised), &mut self.readings);
        self.gains.set_back(&mut self.readings);
    }

    /// Corrects the state by what was read, one number after the other.
    pub fn take_in(&mut self, told: &mut dyn FnMut(&Innovation)) {
        let (mean, gains) = (&mut self.mean, &mut self.gains);
        if let Some(columns) = &mut self.columns {
            columns.read(mean, &gains.linearised, &self.readings);
        }
        // Every reading has noise: without a variance the covariance is beyond repair.
        if !gains.correct(&self.readings) {
            mean.lost = true;
            return;
        }
        mean.take_in(&self.readings, &gains.gain, told);
        if let Some(columns) = &mut self.columns {
            columns.take_in(&self.readings, &gains.gain, &mean.values);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.take_in(&gains.gain);
        }
        if let Some(trail) = self.trail.as_mut().filter(|_| !mean.lost) {
            trail.take_in(&self.readings, &gains.gain, &mean.values);
        }
    }

    fn propagate(&mut self, to_ns: i64) {
        let (mean, gains) = (&mut self.mean, &mut self.gains);
        let case = mean.case;
        gains.set_out();
        while mean.plant.now_ns() < to_ns && !mean.lost {
            let from_ns = mean.plant.now_ns();
            let left_ns = to_ns - from_ns;
            // Equal steps, so that none is tiny.
            let steps = (left_ns as f64 * 1e-9 / gains.longest_s()).ceil().clamp(1.0, 1e6);
            let end_ns = (from_ns + ((left_ns as f64 / steps).ceil() as i64).max(1)).min(to_ns);
            if let Some(columns) = &mut self.columns {
                columns.set_out(mean, end_ns, to_ns);
            }
            mean.advance(end_ns, gains.last_step());
            gains.follow(&mean.plant, end_ns - from_ns);
            if let Some(columns) = &mut self.columns {
                mean.lost |= !columns.follow(case, &mean.plant, gains);
            }
            mean.follow_motors(&gains.step.transition, gains.unseen_axis.as_ref());
            if let Some(recorder) = &mut self.recorder {
                recorder.step(end_ns, gains, mean.layout);
            }
            if let Some(trail) = &mut self.trail {
                trail.step(end_ns - from_ns, gains);
            }
        }
        if let Some(claims) = &mut gains.claims {
            claims.arrive();
        }
        self.hold_wheels();
    }

    /// Nothing is uncertain of a wheel that its friction holds.
    fn hold_wheels(&mut self) {
        for (i, held) in self.mean.layout.plant.wheels().zip(self.mean.plant.held_wheels()) {
            if held {
                self.gains.hold(i);
                self.columns.iter_mut().for_each(|columns| columns.hold(i));
                self.trail.iter_mut().for_each(|trail| trail.hold(i));
            }
        }
    }
}

/// How far from a start a filter begins whose start moves from pass to pass, while what was known of the sensors' biases before the run
/// stays about none, and what that adds to the log likelihood. With b the start's biases, B the variances known of them and P the start's
/// covariance, in which B is a part of the information,
///
/// ```text
/// start' = start - P B^-1 b        log p' = log p - b B^-1 b/2 + b B^-1 P B^-1 b/2
/// ```
///
/// Otherwise pass after pass would move the biases as if nothing were known of them, against a tilt that looks the same.
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
