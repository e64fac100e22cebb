//! Passes over recordings, and what they say of parameters.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::columns::Columns;
use crate::design::Design;
use crate::error::PredictionError;
use crate::filter::Filter;
use crate::from_start::FromStart;
use crate::frozen::FrozenPass;
use crate::kept_gains::{FrozenGains, Recorder};
use crate::laws::Laws;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::other::Varied;
use crate::parameter::Parameter;
use crate::prepared::Prepared;
use crate::start::Start;
use crate::sums::{Sums, Widening};

/// What a pass over a recording says.
pub(crate) struct Pass {
    likelihood: Likelihood,
    /// How the start moves that the run shows.
    shift: DVector<f64>,
    pub sums: Sums,
    /// Covariance of the start given the run here or close by.
    own: DMatrix<f64>,
    /// How innovations change with the parameters here or close by, for passes near this one.
    kept: Option<Arc<Kept>>,
}

/// A design matrix, and what else of the pass does not depend on the innovations.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    /// Columns of the state at the start, then those of the parameters.
    pub design: Design,
    pub gains: FrozenGains,
    pub sums: Sums,
    pub widening: Widening,
    own: DMatrix<f64>,
}

impl Kept {
    /// The sums of a pass close by with this slope, which says this of its start.
    pub fn sums(&self, slope: &DVector<f64>, shift: &DVector<f64>) -> Sums {
        let (states, parameters) = self.sums.of_start.shape();
        Sums { slope: slope.rows(states, parameters) + &self.widening.of_slope * shift, ..self.sums.clone() }
    }
}

/// Passes over all recordings at one place.
pub(crate) struct Passes(pub Vec<Pass>);

impl Passes {
    pub fn log_likelihood(&self) -> f64 {
        self.0.iter().map(Pass::log_likelihood).sum()
    }

    /// Mean square of the normalised innovations, 1 at least.
    pub fn misfit(&self) -> f64 {
        let sum = |of: fn(&Likelihood) -> f64| self.0.iter().map(|pass| of(&pass.likelihood)).sum::<f64>();
        (sum(|l| l.chi_squared) / sum(|l| l.numbers as f64).max(1.0)).max(1.0)
    }

    /// Whether each shows how its innovations change, for passes near these.
    pub fn are_kept(&self) -> bool {
        self.0.iter().all(|pass| pass.kept.is_some())
    }

    /// How the n-th changes with the parameters.
    pub fn kept(&self, n: usize) -> Option<&Arc<Kept>> {
        self.0.get(n)?.kept.as_ref()
    }

    pub fn information(&self, parameters: &[Parameter]) -> DMatrix<f64> {
        let known = DVector::from_iterator(parameters.len(), parameters.iter().map(|p| p.stddev.powi(-2)));
        self.0.iter().fold(DMatrix::from_diagonal(&known), |sum, of| sum + &of.sums.information)
    }

    pub fn slope(&self, parameters: &[Parameter], at: &[f64]) -> DVector<f64> {
        let pulls = parameters.iter().zip(at).map(|(p, x)| -x * p.stddev.powi(-2));
        let known = DVector::from_iterator(parameters.len(), pulls);
        self.0.iter().fold(known, |sum, of| sum + &of.sums.slope)
    }

    /// Starts with the covariances that the runs leave of them.
    pub fn starts(&self, runs: Vec<(Noise, Start)>) -> Vec<(Start, DMatrix<f64>)> {
        runs.into_iter().zip(&self.0).map(|((_, start), pass)| (start, pass.own.clone())).collect()
    }

    /// Starts this share of the way to where the runs show them, when the parameters move so.
    pub fn moved(&self, runs: &[(Noise, Start)], by: &DVector<f64>, share: f64) -> Vec<(Noise, Start)> {
        let with = runs.iter().zip(&self.0);
        with.map(|((noise, start), pass)| {
            let mut shift = &pass.shift * share + &pass.sums.of_start * by;
            // Of disturbances nothing is known at the start but their levels.
            let layout = start.layout;
            shift.rows_range_mut(layout.plant.size()..layout.moving()).fill(0.0);
            (noise.clone(), start.moved(&shift))
        })
        .collect()
    }
}

/// A pass over a recording with columns; `keeps`: gains, and how each innovation changes, for passes close by.
pub(crate) fn pass(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
    laws: Option<&Laws<'_>>,
    keeps: bool,
) -> Result<Pass, PredictionError> {
    let columns = Columns::new(case, start.layout, true, varied, laws)?;
    let all = start.layout.size() + columns.count();
    let design = if keeps { Design::new(all, case.numbers()) } else { None };
    let mut filter = Filter::new(case, noise, start).about_known_biases(start);
    filter.recorder = design.is_some().then(|| Recorder::new(filter.begun().0.clone()));
    let mut filter = filter.varying(columns.keeping(design));
    let mut likelihood = Likelihood::begun(filter.log_known);
    while filter.step(&mut |innovation| likelihood.add(innovation)) {}
    likelihood.lost = filter.is_lost();
    let found = FromStart::of(&mut filter);
    let FromStart { shift, sums, design, own } = found;
    let (narrow, _) = filter.begun();
    let wide = filter.gains.heading.out_of(&Start::wide(case, noise).covariance);
    let (mut sums, widening) = sums.widened(&own, narrow, &wide);
    sums.slope += &widening.of_slope * &shift;
    let shift = &widening.of_shift * shift;
    let gains = filter.recorder.take().and_then(Recorder::end);
    let kept = design.zip(gains).filter(|_| !likelihood.lost);
    let kept = kept.map(|(design, gains)| {
        Arc::new(Kept { design, gains, sums: sums.clone(), widening, own: own.clone() })
    });
    Ok(Pass { likelihood, shift, sums, own, kept })
}

/// A pass over a recording without columns; with those of another pass close by, and its gains, it shows the slope as well.
pub(crate) fn pass_near(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: Option<&Arc<Kept>>) -> Pass {
    if let Some(pass) = kept.and_then(|kept| pass_with_gains(case, noise, start, kept)) {
        return pass;
    }
    // Nothing else is varied, and a model that can be predicted is one.
    pass(case, noise, start, &[], None, false).unwrap_or_else(|_| Pass::lost(start))
}

/// A pass with the gains of another one; `None` where other readings are due than there.
fn pass_with_gains(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: &Arc<Kept>) -> Option<Pass> {
    let mut filter = FrozenPass::new(case, noise, start, &kept.gains);
    let mut likelihood = Likelihood::begun(filter.log_known);
    let mut slope = kept.design.no_slope();
    while filter.step(&mut |innovation| {
        kept.design.add_slope(likelihood.numbers, innovation.normalised(), &mut slope);
        likelihood.add(innovation);
    }) {}
    if filter.is_other {
        return None;
    }
    likelihood.lost = filter.mean.lost;
    let shift = &filter.begun + kept.gains.known() * slope.rows(0, start.layout.size());
    let sums = kept.sums(&slope, &shift);
    let shift = &kept.widening.of_shift * shift;
    Some(Pass { likelihood, shift, sums, own: kept.own.clone(), kept: Some(Arc::clone(kept)) })
}

impl Pass {
    /// log p of the recording; minus infinity where it cannot be followed.
    pub fn log_likelihood(&self) -> f64 {
        if self.likelihood.lost { f64::NEG_INFINITY } else { self.likelihood.log }
    }

    /// Of a motion that cannot be followed.
    fn lost(start: &Start) -> Self {
        let likelihood = Likelihood { log: f64::NEG_INFINITY, lost: true, ..Likelihood::default() };
        let size = start.layout.size();
        let (shift, own) = (DVector::zeros(size), start.covariance.clone());
        Self { likelihood, shift, sums: Sums::none(size, 0), own, kept: None }
    }
}
