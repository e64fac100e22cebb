//! Passes over recordings, and what they say of parameters.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::columns::{Columns, Sums};
use crate::design::{Design, Kept, Order};
use crate::error::PredictionError;
use crate::filter::Filter;
use crate::laws::Laws;
use crate::likelihood::Likelihood;
use crate::noise::Noise;
use crate::other::Varied;
use crate::parameter::Parameter;
use crate::prepared::Prepared;
use crate::start::Start;

/// What a pass over a recording says.
pub(crate) struct Pass {
    likelihood: Likelihood,
    /// How the start moves that the run shows.
    shift: DVector<f64>,
    pub sums: Sums,
    /// How innovations change with the parameters here or close by, for passes near this one.
    kept: Option<Arc<Kept>>,
}

/// Passes over all recordings at one place.
pub(crate) struct Passes(pub Vec<Pass>);

impl Passes {
    pub fn log_likelihood(&self) -> f64 {
        let all = self.0.iter().map(|pass| &pass.likelihood);
        all.map(|l| if l.lost { f64::NEG_INFINITY } else { l.log }).sum()
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

/// A pass over a recording with columns; `keeps`: how each innovation changes, for passes close by.
pub(crate) fn pass(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
    laws: Option<&Laws<'_>>,
    keeps: bool,
) -> Result<Pass, PredictionError> {
    let columns = Columns::new(case, start.layout.size(), varied, laws)?;
    let parameters = columns.count();
    let design = if keeps { Design::new(parameters, case.numbers()) } else { None };
    let mut filter = Filter::new(case, noise, start).looking_back().varying(columns.keeping(design));
    let (mut likelihood, mut order) = (Likelihood::default(), Order::default());
    while filter.step(&mut |innovation| {
        likelihood.add(innovation);
        if keeps {
            order.add(innovation);
        }
    }) {}
    let (sums, design) = match filter.columns.take() {
        Some(columns) => columns.sums(),
        None => (Sums::none(start.layout.size(), parameters), None),
    };
    let kept = design.filter(|_| !filter.lost).map(|design| Arc::new(Kept::new(design, order, &sums)));
    Ok(ended(filter, likelihood, sums, start, kept))
}

/// A pass over a recording without columns; with those of another pass close by it shows the slope as well.
pub(crate) fn pass_near(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: Option<&Arc<Kept>>) -> Pass {
    let mut filter = Filter::new(case, noise, start).looking_back();
    let (mut likelihood, mut order) = (Likelihood::default(), Order::default());
    let mut slope = kept.map_or_else(|| DVector::zeros(0), |kept| kept.no_slope());
    while filter.step(&mut |innovation| {
        if let Some(kept) = kept {
            kept.design.add_slope(likelihood.numbers, innovation.normalised(), &mut slope);
            order.add(innovation);
        }
        likelihood.add(innovation);
    }) {}
    let sums = kept.and_then(|kept| kept.sums(slope, &order));
    let kept = kept.filter(|_| sums.is_some()).cloned();
    let sums = sums.unwrap_or_else(|| Sums::none(start.layout.size(), 0));
    ended(filter, likelihood, sums, start, kept)
}

/// What a filter has found at the end, as if it had begun with what was known before the run.
fn ended(
    filter: Filter<'_>,
    mut likelihood: Likelihood,
    sums: Sums,
    start: &Start,
    kept: Option<Arc<Kept>>,
) -> Pass {
    likelihood.lost = filter.lost;
    let heading = filter.heading;
    let Some(origin) = filter.origin else {
        return Pass { likelihood, shift: DVector::zeros(start.layout.size()), sums, kept };
    };
    let mut shift = origin.shift;
    let [narrow, wide] = [&start.covariance, &Start::wide(filter.case, filter.noise).covariance]
        .map(|known| heading.out_of(known));
    let sums = sums.widened(&mut shift, &origin.own, &narrow, &wide);
    Pass { likelihood, shift, sums, kept }
}
