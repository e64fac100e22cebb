//! Passes over recordings, and what they say of starts and parameters.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use whorl_math::covariance::Whitened;
use whorl_math::lanes::{Gain, Lanes};

use crate::columns::Columns;
use crate::filter::{Filter, begun_about_known_biases};
use crate::innovations::Mean;
use crate::rows::Readings;
use crate::within::{Responses, Within};
use crate::{Innovation, Laws, Likelihood, Noise, PredictionError, Prepared, Start, Varied};

/// Bytes that are kept at most of gains and of how innovations change: six minutes at 100 Hz of nine numbers and 70 parameters.
const MOST_BYTES: usize = 192 << 20;

pub(crate) struct Pass {
    pub likelihood: Likelihood,
    /// How the start moves that the run shows, from where it was given.
    pub shift: DVector<f64>,
    /// d log p / dtheta.
    pub slope: DVector<f64>,
    pub sums: Sums,
    /// For passes close by: innovations are white, so that if their changes are a little other, the slope errs by as small a share of a deviation.
    pub kept: Option<Arc<Kept>>,
}

/// What of a pass does not depend on its innovations.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// -d^2 log p / dtheta^2, Gauss and Newton's.
    pub information: DMatrix<f64>,
    /// How the start that the run shows moves with the parameters, and its covariance given the run.
    pub of_start: DMatrix<f64>,
    pub own: DMatrix<f64>,
    /// About which axis the attitude at the start is of no consequence.
    unseen_axis: Option<Vector3<f64>>,
}

/// How innovations change with the start and the parameters, and the gains with which they do.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    gains: FrozenGains,
    /// Changes of the normalised innovations, one after the other, each by the state at the start and then by the parameters; a share of 1e-7 is enough.
    design: Vec<f32>,
    sums: Sums,
    widened: Option<Widened>,
    responses: Responses,
}

/// What it changes that a filter began with less than it was given: how the start moves by how it moved, and what is added to the slope by that.
type Widened = [DMatrix<f64>; 2];

impl Pass {
    /// Over the first so many instants, without parameters.
    pub fn of_start(case: &Prepared<'_>, noise: &Noise, start: &Start, most: usize) -> Self {
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        filter.columns = Some(Columns::of_state(start.layout, true, 0, None));
        let likelihood = filter.run(most, &mut |_| {});
        Self::behind(&mut filter, likelihood).0
    }

    /// Over a whole recording with columns of parameters and laws; `keeps`: what passes close by need.
    pub fn of(
        case: &Prepared<'_>,
        noise: &Noise,
        start: &Start,
        varied: &[Varied],
        laws: Option<&Laws<'_>>,
        keeps: bool,
    ) -> Result<Self, PredictionError> {
        let mut columns = Columns::new(case, start.layout, true, varied, laws)?;
        let changes = columns.blocks.count() * case.numbers();
        let mut filter = Filter::new(case, noise, start).about_known_biases(start);
        let bytes = changes * size_of::<f32>() + start.layout.size() * case.numbers() * size_of::<f64>();
        if keeps && bytes <= MOST_BYTES {
            columns.blocks.design = Some(Vec::with_capacity(changes));
            filter.kept = Some(Vec::new());
        }
        filter.columns = Some(columns);
        filter.mean.sees_inputs = true;
        let likelihood = filter.run(usize::MAX, &mut |_| {});
        let responses = filter.columns.as_mut().map(|columns| std::mem::take(&mut columns.responses));
        let responses = responses.unwrap_or_default();
        let (mut pass, design) = Self::behind(&mut filter, likelihood);
        if !responses.is_empty() {
            pass.slope += filter.mean.apart.slope(&responses);
        }
        let wide = pass.sums.seen(&Start::wide(case, noise).covariance);
        let widened = pass.sums.widen(&filter.known, &wide);
        let mut pass = pass.widened(widened.as_ref());
        let kept = design.zip(FrozenGains::of(&mut filter));
        pass.kept = kept.map(|(design, gains)| {
            Arc::new(Kept { gains, design, sums: pass.sums.clone(), widened, responses })
        });
        Ok(pass)
    }

    fn widened(mut self, by: Option<&Widened>) -> Self {
        if let Some([of_shift, of_slope]) = by {
            self.slope += of_slope * &self.shift;
            self.shift = of_shift * self.shift;
        }
        self
    }

    /// Without columns; with those of another pass close by, and its gains, it shows the slope as well.
    pub fn near(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: Option<&Arc<Kept>>) -> Self {
        kept.and_then(|kept| Self::with_gains(case, noise, start, kept))
            .unwrap_or_else(|| Self::of_start(case, noise, start, usize::MAX))
    }

    /// With the gains of another one; `None` where other readings are due than there.
    fn with_gains(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: &Arc<Kept>) -> Option<Self> {
        let (states, parameters) = kept.sums.of_start.shape();
        let mut slope = DVector::zeros(states + parameters);
        let mut changes = kept.design.chunks_exact(states + parameters);
        let told = &mut |innovation: &Innovation| {
            let normalised = innovation.normalised();
            let changes = changes.next().unwrap_or_default();
            slope.iter_mut().zip(changes).for_each(|(slope, d)| *slope -= normalised * f64::from(*d));
        };
        let (likelihood, begun, apart) = passed(case, noise, start, &kept.gains, told)?;
        let shift = begun + &kept.gains.known * slope.rows(0, states);
        let slope = slope.rows(states, parameters) + apart.slope(&kept.responses);
        let pass = Self { likelihood, shift, slope, sums: kept.sums.clone(), kept: Some(Arc::clone(kept)) };
        Some(pass.widened(kept.widened.as_ref()))
    }

    /// Of a filter that has columns of its start, which it gives away with the changes of its innovations, if it kept them. With P the covariance
    /// with which it began, g and G slope and information of the columns of the start and C what these have in common with those of the parameters,
    ///
    /// ```text
    /// shift = P g        own = P - P G P        d start/d parameters = -P C
    /// ```
    fn behind(filter: &mut Filter<'_>, likelihood: Likelihood) -> (Self, Option<Vec<f32>>) {
        let (known, unseen_axis) = (&filter.known, filter.gains.unseen_at_start);
        let states = known.nrows();
        let said = filter.columns.take().map(|columns| columns.blocks.said());
        let (information, slope, design) = said.unwrap_or_default();
        let parameters = slope.len().saturating_sub(states);
        let block = |at, shape| information.view(at, shape);
        let (shift, own) = if likelihood.lost {
            (DVector::zeros(states), known.clone())
        } else {
            let own = known - known * block((0, 0), (states, states)) * known;
            (&filter.begun + known * slope.rows(0, states), own)
        };
        let of_start = -(known * block((0, states), (states, parameters)));
        let information = block((states, states), (parameters, parameters)).into_owned();
        let slope = slope.rows(states, parameters).into_owned();
        let sums = Sums { information, of_start, own, unseen_axis };
        (Self { likelihood, shift, slope, sums, kept: None }, design)
    }
}

impl Sums {
    /// A covariance of the start without what of its attitude is of no consequence.
    pub fn seen(&self, covariance: &DMatrix<f64>) -> DMatrix<f64> {
        let Some(axis) = &self.unseen_axis else { return covariance.clone() };
        let mut lanes = Lanes::of(covariance);
        lanes.level_covariance(axis);
        lanes.matrix(covariance.nrows(), covariance.ncols())
    }

    /// As if the filter had begun with what was known before the run, `wide`, and not with what the run made of it, `narrow`, which
    /// holds the start where parameters would move it; and what that does to how the start moves and to the slope (METHOD.md, "Fits").
    fn widen(&mut self, narrow: &DMatrix<f64>, wide: &DMatrix<f64>) -> Option<Widened> {
        let known = Whitened::by(wide);
        let one = DMatrix::identity(known.back.nrows(), known.back.nrows());
        let twice = known.units(narrow).try_inverse()? - &one;
        let free = (one - known.units(&self.own) * &twice).lu().solve(&known.back)?;
        let of_slope = (&known.back * &self.of_start).transpose() * twice * &free;
        let of_shift = known.basis * free;
        self.information -= &of_slope * &self.of_start;
        self.of_start = &of_shift * &self.of_start;
        Some([of_shift, of_slope])
    }
}

/// Each innovation of a recording, and how it changes with the parameters along which models were varied, per their units.
///
/// # Errors
/// A varied model that cannot be simulated.
pub fn sensitivities(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
    told: &mut dyn FnMut(&Innovation, &DVector<f64>),
) -> Result<(), PredictionError> {
    let mut filter = Filter::new(case, noise, start);
    filter.columns = Some(Columns::new(case, start.layout, false, varied, None)?);
    let (mut found, mut latest) = (Vec::new(), DVector::zeros(varied.len()));
    while filter.step(&mut |innovation| found.push(*innovation)) {
        for (reading, innovation) in found.drain(..).enumerate() {
            let Some(Columns { blocks, .. }) = &mut filter.columns else { continue };
            latest.iter_mut().enumerate().for_each(|(column, slot)| *slot = *blocks.reading(reading, column));
            told(&innovation, &latest);
        }
    }
    Ok(())
}

/// Gains at each instant \[ns\], and the covariance with which their filter began: any gain makes a causal predictor, and near an optimum they hardly change.
#[derive(Debug, Clone)]
pub struct FrozenGains {
    known: DMatrix<f64>,
    by_instant: Vec<(i64, Gain)>,
}

impl FrozenGains {
    /// Of a filter that kept them; `None` where its motion was lost.
    fn of(filter: &mut Filter<'_>) -> Option<Self> {
        let by_instant = filter.kept.take().filter(|_| !filter.mean.lost)?;
        Some(Self { known: filter.known.clone(), by_instant })
    }
}

/// Gains of a filter with these levels of noise along the motion from a start; `None` where the motion is lost.
pub fn frozen_gains(case: &Prepared<'_>, noise: &Noise, start: &Start) -> Option<FrozenGains> {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    filter.kept = Some(Vec::new());
    filter.run(usize::MAX, &mut |_| {});
    FrozenGains::of(&mut filter)
}

/// Innovations of a recording with gains that were made close by; `None` where other readings are due than there.
pub fn innovations(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    kept: &FrozenGains,
    told: &mut dyn FnMut(&Innovation),
) -> Option<Likelihood> {
    passed(case, noise, start, kept, told).map(|(likelihood, ..)| likelihood)
}

/// The same with how far from the start that was given it began: what was known of the biases before the run stays about none.
fn passed(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    kept: &FrozenGains,
    told: &mut dyn FnMut(&Innovation),
) -> Option<(Likelihood, DVector<f64>, Within)> {
    let (begun, log_known) = begun_about_known_biases(case, start, &kept.known);
    let mut mean = Mean::new(case, noise, start);
    mean.sees_inputs = true;
    mean.change(&begun);
    let mut likelihood = Likelihood::begun(log_known);
    let (mut readings, mut instants) = (Readings::default(), kept.by_instant.iter());
    while let Some(instant_ns) = mean.set_out().filter(|_| !mean.lost) {
        let (_, gain) = instants.next().filter(|(at_ns, _)| *at_ns == instant_ns)?;
        mean.advance(instant_ns);
        if mean.lost {
            break;
        }
        mean.find_due(instant_ns);
        mean.read(None, &mut readings);
        if readings.rows.len() != gain.count() {
            return None;
        }
        mean.take_in(&readings, gain, &mut |innovation| {
            likelihood.add(innovation);
            told(innovation);
        });
    }
    likelihood.end(&mean);
    Some((likelihood, begun, mean.apart))
}
