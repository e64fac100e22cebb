//! Values where recordings are likeliest with fixed levels of noise.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::problem::{Iterate, Problem};
use crate::error::PredictionError;
use crate::noise::Noise;
use crate::passes::Passes;
use crate::start::Start;

/// What is tried of a step that makes the recordings less likely as a whole.
const SHARES_OF_A_STEP: [f64; 4] = [1.0, 0.5, 0.2, 0.05];

/// A step does what columns have said if its gain is as large as theirs but for this share: Nocedal and Wright, *Numerical
/// Optimization*, algorithm 4.1, the share at which a model is trusted further.
const AS_SAID: f64 = 0.25;

/// Where values are likeliest at fixed levels.
pub(super) struct Ascent {
    pub at: Vec<f64>,
    /// The recordings' starts there, with their covariances given all readings.
    pub starts: Vec<(Start, DMatrix<f64>)>,
    pub end: End,
    pub information: DMatrix<f64>,
    /// What passes say there.
    pub passes: Passes,
}

/// A place on the way.
struct Place {
    at: Vec<f64>,
    runs: Vec<(Noise, Start)>,
    passes: Passes,
    /// Columns are those of a place close by.
    is_near: bool,
}

impl Place {
    fn ended(self, end: End, information: DMatrix<f64>) -> Ascent {
        let starts = self.passes.starts(self.runs);
        Ascent { at: self.at, starts, end, information, passes: self.passes }
    }
}

/// How an ascent ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// No further gain is predicted.
    Top,
    /// The predicted gain is too small to become as likely as it should.
    Hopeless,
    /// The predicted gain is not found.
    Stuck,
    /// It took as many steps as it may.
    Steps,
}

impl Problem<'_> {
    /// The likeliest values with these levels: roughly while levels are those of another model. `known`: what passes say where it begins.
    pub fn ascent(
        &self,
        begun: &Iterate,
        known: Option<Passes>,
        roughly: bool,
        least: f64,
    ) -> Result<Ascent, PredictionError> {
        let (settings, parameters) = (self.settings, self.parameters);
        let stands_nats = if roughly { settings.fit_round_nats } else { settings.fit_stands_nats };
        let (at, runs) = (begun.at.clone(), begun.runs());
        let passes = known.map_or_else(|| self.passes(&at, &runs), Ok)?;
        let mut here = Place { at, runs, passes, is_near: false };
        for _ in 0..settings.fit_steps {
            let passes = &here.passes;
            let log = passes.log_likelihood() + self.log_prior(&here.at);
            let slope = passes.slope(parameters, &here.at);
            let held = self.held(&here.at, &slope);
            let information = passes.information(parameters);
            let Some(step) = solved(&information, &slope, &held) else { break };
            let predicted = 0.5 * step.dot(&slope);
            if predicted <= stands_nats * passes.misfit() {
                return Ok(here.ended(End::Top, information));
            }
            // Twice the gain that a parabola predicts.
            if log + 2.0 * predicted < least {
                return Ok(here.ended(End::Hopeless, information));
            }
            // The change of gains is no part of the slope: at the top nothing is likelier in its direction.
            let is_close = predicted <= settings.fit_round_nats * passes.misfit();
            let shares = if is_close { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            if let Some(next) = shares.iter().find_map(|share| self.likelier(&here, &step, *share, log)) {
                here = self.with_columns_where_needed(here, next, log, &slope, &information)?;
            } else if here.is_near {
                here = self.with_columns(here)?;
            } else {
                return Ok(here.ended(if is_close { End::Top } else { End::Stuck }, information));
            }
        }
        let information = here.passes.information(parameters);
        Ok(here.ended(End::Steps, information))
    }

    /// A place by this share of a step, if it is likelier than that; with the columns of where it set out.
    fn likelier(&self, from: &Place, step: &DVector<f64>, share: f64, log: f64) -> Option<Place> {
        let at = self.within(&from.at, &(step * share));
        let moved = moved(&from.at, &at);
        let runs = from.passes.moved(&from.runs, &moved, share);
        let passes = self.passes_near(&at, &runs, &from.passes).ok()?;
        let is_likelier = passes.log_likelihood() + self.log_prior(&at) > log;
        is_likelier.then_some(Place { at, runs, passes, is_near: true })
    }

    /// The next place; with its own columns unless it is as much likelier as those of the one before have said.
    fn with_columns_where_needed(
        &self,
        from: Place,
        next: Place,
        log: f64,
        slope: &DVector<f64>,
        information: &DMatrix<f64>,
    ) -> Result<Place, PredictionError> {
        let by = moved(&from.at, &next.at);
        let said = by.dot(slope) - 0.5 * by.dot(&(information * &by));
        let gain = next.passes.log_likelihood() + self.log_prior(&next.at) - log;
        let small = self.settings.fit_stands_nats * next.passes.misfit();
        let is_as_said = (gain - said).abs() <= (AS_SAID * said).max(small);
        if is_as_said && next.passes.are_kept() { Ok(next) } else { self.with_columns(next) }
    }

    fn with_columns(&self, place: Place) -> Result<Place, PredictionError> {
        let passes = self.passes(&place.at, &place.runs)?;
        Ok(Place { passes, is_near: false, ..place })
    }

    /// Which parameters stand at an end of their range that the slope does not lead away from.
    pub fn held(&self, at: &[f64], slope: &DVector<f64>) -> Vec<bool> {
        let ends = self.parameters.iter().zip(at).zip(slope.iter());
        ends.map(|((p, x), up)| (*x <= p.range.0 && *up <= 0.0) || (*x >= p.range.1 && *up >= 0.0)).collect()
    }

    fn within(&self, at: &[f64], step: &DVector<f64>) -> Vec<f64> {
        let moved = self.parameters.iter().zip(at).zip(step.iter());
        moved.map(|((p, x), step)| (x + step).max(p.range.0).min(p.range.1)).collect()
    }
}

fn moved(from: &[f64], to: &[f64]) -> DVector<f64> {
    DVector::from_iterator(from.len(), to.iter().zip(from).map(|(to, from)| to - from))
}

/// The step that leaves the held parameters where they are.
fn solved(information: &DMatrix<f64>, slope: &DVector<f64>, held: &[bool]) -> Option<DVector<f64>> {
    let (mut information, mut slope) = (information.clone(), slope.clone());
    for i in (0..held.len()).filter(|i| held[*i]) {
        information.row_mut(i).fill(0.0);
        information.column_mut(i).fill(0.0);
        information[(i, i)] = 1.0;
        slope[i] = 0.0;
    }
    let step = Cholesky::new(information)?.solve(&slope);
    step.iter().all(|x| x.is_finite()).then_some(step)
}
