//! Passes over recordings, and what they say of parameters.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use crate::columns::Columns;
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
use crate::sums::{Sums, Widening};

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
    let columns = Columns::new(case, start.layout, varied, laws)?;
    let parameters = columns.count();
    let design = if keeps { Design::new(parameters, case.numbers()) } else { None };
    let mut filter = Filter::new(case, noise, start)
        .about_known_biases(start)
        .looking_back()
        .varying(columns.keeping(design));
    let (mut likelihood, mut order) = (Likelihood::begun(&filter), Order::default());
    while filter.step(&mut |innovation| {
        likelihood.add(innovation);
        if keeps {
            order.add(innovation.component, innovation.sample);
        }
    }) {}
    likelihood.lost = filter.lost;
    let (sums, design) = match filter.columns.take() {
        Some(columns) => columns.sums(),
        None => (Sums::none(start.layout.size(), parameters), None),
    };
    let (shift, sums, widening) = from_what_was_known(&mut filter, start, sums);
    let kept =
        design.filter(|_| !filter.lost).map(|design| Arc::new(Kept::new(design, order, &sums, widening)));
    Ok(Pass { likelihood, shift, sums, kept })
}

/// A pass over a recording without columns; with those of another pass close by it shows the slope as well.
pub(crate) fn pass_near(case: &Prepared<'_>, noise: &Noise, start: &Start, kept: Option<&Arc<Kept>>) -> Pass {
    let mut filter = Filter::new(case, noise, start).about_known_biases(start).looking_back();
    let (mut likelihood, mut order) = (Likelihood::begun(&filter), Order::default());
    let mut slope = kept.map_or_else(|| DVector::zeros(0), |kept| kept.no_slope());
    while filter.step(&mut |innovation| {
        if let Some(kept) = kept {
            kept.design.add_slope(likelihood.numbers, innovation.normalised(), &mut slope);
            order.add(innovation.component, innovation.sample);
        }
        likelihood.add(innovation);
    }) {}
    likelihood.lost = filter.lost;
    let shift = filter.origin.as_ref().map(|origin| &origin.shift);
    let with = kept.zip(shift).and_then(|(kept, shift)| {
        let shift_of_run = &kept.widening.of_shift * shift;
        Some((kept.sums(slope, shift, &order)?, shift_of_run, Arc::clone(kept)))
    });
    if let Some((sums, shift, kept)) = with {
        return Pass { likelihood, shift, sums, kept: Some(kept) };
    }
    let (shift, sums, _) = from_what_was_known(&mut filter, start, Sums::none(start.layout.size(), 0));
    Pass { likelihood, shift, sums, kept: None }
}

/// How the start moves that a run shows, and what it says of parameters, as if the filter had begun with what was known before the run.
fn from_what_was_known(filter: &mut Filter<'_>, start: &Start, sums: Sums) -> (DVector<f64>, Sums, Widening) {
    let heading = filter.heading;
    let wide = Start::wide(filter.case, filter.noise).covariance;
    let [narrow, wide] = [&start.covariance, &wide].map(|known| heading.out_of(known));
    let size = start.layout.size();
    let (own, shift) = match filter.origin.take() {
        Some(origin) => origin.end(),
        None => (narrow.clone(), DVector::zeros(size)),
    };
    let (mut sums, widening) = sums.widened(&own, &narrow, &wide);
    sums.slope += &widening.of_slope * &shift;
    (&widening.of_shift * shift, sums, widening)
}
