//! Values where recordings are likeliest with fixed levels of noise.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::problem::{Problem, Standing};
use crate::error::PredictionError;
use crate::noise::Noise;
use crate::passes::Passes;
use crate::start::Start;

/// What is tried of a step that makes the recordings less likely as a whole.
const SHARES_OF_A_STEP: [f64; 4] = [1.0, 0.5, 0.2, 0.05];

/// Where values are likeliest at fixed levels.
pub(super) struct Climbed {
    pub at: Vec<f64>,
    /// The recordings' starts there.
    pub starts: Vec<Start>,
    pub end: End,
    pub information: DMatrix<f64>,
}

/// How a climb ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// Nothing likelier is promised.
    Top,
    /// Too little is promised to become as likely as it should.
    Hopeless,
    /// What is promised is not found.
    Stuck,
    /// It took as many steps as it may.
    Steps,
}

impl Problem<'_> {
    /// The likeliest values with these levels: roughly while levels are those of another model.
    pub fn climbed(&self, begun: &Standing, roughly: bool, least: f64) -> Result<Climbed, PredictionError> {
        let (settings, parameters) = (self.settings, self.parameters);
        let stands_nats = if roughly { settings.fit_round_nats } else { settings.fit_stands_nats };
        let (mut at, mut runs) = (begun.at.clone(), begun.runs());
        let starts = |runs: Vec<(Noise, Start)>| runs.into_iter().map(|(_, start)| start).collect();
        let mut here = self.passes(&at, &runs)?;
        let ended = |at, runs, end, information| Climbed { at, starts: starts(runs), end, information };
        for _ in 0..settings.fit_steps {
            let log = here.log_likelihood() + self.log_prior(&at);
            let slope = here.slope(parameters, &at);
            let held = self.held(&at, &slope);
            let information = here.information(parameters);
            let Some(step) = solved(&information, &slope, &held) else { break };
            if 0.5 * step.dot(&slope) <= stands_nats * here.misfit() {
                return Ok(ended(at, runs, End::Top, information));
            }
            // Twice what a parabola promises.
            if log + step.dot(&slope) < least {
                return Ok(ended(at, runs, End::Hopeless, information));
            }
            // The change of gains is no part of the slope: at the top nothing is likelier in its direction.
            let is_close = 0.5 * step.dot(&slope) <= settings.fit_round_nats * here.misfit();
            let shares = if is_close { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            let tried = shares.iter().find_map(|share| {
                let next = self.within(&at, &(&step * *share));
                let moved = DVector::from_iterator(at.len(), next.iter().zip(&at).map(|(a, b)| a - b));
                let next_runs = here.moved(&runs, &moved, *share);
                let is_likelier = |passes: &Passes| passes.log_likelihood() + self.log_prior(&next) > log;
                // A whole step mostly is likelier, and its columns are needed next; of a part of one nobody knows.
                if *share < 1.0 && !is_likelier(&self.passes_alone(&next, &next_runs).ok()?) {
                    return None;
                }
                let passes = self.passes(&next, &next_runs).ok()?;
                is_likelier(&passes).then_some((next, next_runs, passes))
            });
            let Some(next) = tried else {
                let end = if is_close { End::Top } else { End::Stuck };
                return Ok(ended(at, runs, end, information));
            };
            (at, runs, here) = next;
        }
        let information = here.information(parameters);
        Ok(ended(at, runs, End::Steps, information))
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
