//! Values where recordings are likeliest with fixed levels of noise.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::problem::{Iterate, Problem, Runs, runs_of};
use crate::passes::Pass;
use crate::refusal::PredictionError;

/// What is tried of a step that makes the recordings less likely as a whole.
const SHARES_OF_A_STEP: [f64; 4] = [1.0, 0.5, 0.2, 0.05];

/// A step does what columns have said if its gain is as large as theirs but for this share: Nocedal and Wright, *Numerical
/// Optimization*, algorithm 4.1, the share at which a model is trusted further.
const AS_SAID: f64 = 0.25;

pub(super) struct Place {
    pub at: Vec<f64>,
    pub runs: Runs,
    pub passes: Vec<Pass>,
    /// Columns are those of a place close by.
    is_near: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    /// No further gain is predicted.
    Top,
    /// The predicted gain is too small to become as likely as it should.
    Hopeless,
    /// The predicted gain is not found, or it took as many steps as it may.
    Stuck,
}

impl Problem<'_> {
    /// The likeliest values with these levels, with the information there: roughly while levels are those of another model. `known`: passes where it
    /// begins.
    pub fn ascent(
        &self,
        begun: &Iterate,
        known: Option<Vec<Pass>>,
        roughly: bool,
        least: f64,
    ) -> Result<(Place, End, DMatrix<f64>), PredictionError> {
        let settings = self.settings;
        let stands_nats = if roughly { settings.fit_round_nats } else { settings.fit_stands_nats };
        let (at, runs) = (begun.at.clone(), runs_of(&begun.followed));
        let passes = known.map_or_else(|| self.passes(&at, &runs), Ok)?;
        let mut here = Place { at, runs, passes, is_near: false };
        let mut steps = 0..settings.fit_steps;
        loop {
            let (log, slope, information) = self.normal_equations(&here.at, &here.passes);
            let held = self.held(&here.at, &slope);
            let step = steps.next().and_then(|_| solved(&information, &slope, &held));
            let Some(step) = step else { return Ok((here, End::Stuck, information)) };
            let (predicted, misfit) = (0.5 * step.dot(&slope), misfit(&here.passes));
            if predicted <= stands_nats * misfit {
                return Ok((here, End::Top, information));
            }
            // Twice the gain that a parabola predicts.
            if log + 2.0 * predicted < least {
                return Ok((here, End::Hopeless, information));
            }
            // The change of gains is no part of the slope: at the top nothing is likelier in its direction.
            let is_close = predicted <= settings.fit_round_nats * misfit;
            let shares = if is_close { &SHARES_OF_A_STEP[..1] } else { &SHARES_OF_A_STEP };
            let likelier = shares.iter().find_map(|share| {
                let next = self.moved(&here, &step, *share).ok()?;
                let gain = self.log(&next.at, &next.passes) - log;
                (gain > 0.0).then_some((next, gain))
            });
            here = match likelier {
                // It has its own columns unless it is as much likelier as those of the one before have said.
                Some((next, gain)) => {
                    let by = difference(&here.at, &next.at);
                    let said = by.dot(&slope) - 0.5 * by.dot(&(&information * &by));
                    let small = settings.fit_stands_nats * self::misfit(&next.passes);
                    let is_as_said = (gain - said).abs() <= (AS_SAID * said).max(small);
                    let are_kept = next.passes.iter().all(|pass| pass.kept.is_some());
                    if is_as_said && are_kept { next } else { self.with_columns(next)? }
                }
                None if here.is_near => self.with_columns(here)?,
                None => return Ok((here, if is_close { End::Top } else { End::Stuck }, information)),
            };
        }
    }

    /// A place by this share of a step, with the columns of where it set out; starts go the same share of the way to where the runs show them.
    fn moved(&self, from: &Place, step: &DVector<f64>, share: f64) -> Result<Place, PredictionError> {
        let steps = self.parameters.iter().zip(&from.at).zip(step.iter());
        let at: Vec<f64> =
            steps.map(|((p, x), step)| (x + step * share).max(p.range.0).min(p.range.1)).collect();
        let by = difference(&from.at, &at);
        let runs = from.runs.iter().zip(&from.passes).map(|((noise, start), pass)| {
            let mut shift = &pass.shift * share + &pass.sums.of_start * &by;
            // Of disturbances nothing is known at the start but their levels.
            let layout = start.layout;
            shift.rows_range_mut(layout.plant.size()..layout.moving()).fill(0.0);
            (noise.clone(), start.moved(&shift))
        });
        let runs: Runs = runs.collect();
        let passes = self.passes_near(&at, &runs, &from.passes)?;
        Ok(Place { at, runs, passes, is_near: true })
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
}

fn difference(from: &[f64], to: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(to) - DVector::from_column_slice(from)
}

/// Mean square of the normalised innovations, 1 at least.
fn misfit(passes: &[Pass]) -> f64 {
    let squares: f64 = passes.iter().map(|pass| pass.likelihood.chi_squared).sum();
    let numbers: usize = passes.iter().map(|pass| pass.likelihood.numbers).sum();
    (squares / numbers.max(1) as f64).max(1.0)
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
