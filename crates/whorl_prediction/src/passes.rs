//! Passes over recordings, and what they say of parameters.

use nalgebra::{DMatrix, DVector};

use crate::columns::{Columns, Sums};
use crate::error::PredictionError;
use crate::filter::Filter;
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
    sums: Sums,
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

/// Passes over a recording.
pub(crate) fn pass(
    case: &Prepared<'_>,
    noise: &Noise,
    start: &Start,
    varied: &[Varied],
) -> Result<Pass, PredictionError> {
    let columns = Columns::new(case, start.layout.size(), varied)?;
    let mut filter = Filter::new(case, noise, start).looking_back().varying(columns);
    let mut likelihood = Likelihood::default();
    while filter.step(&mut |innovation| likelihood.add(innovation)) {}
    likelihood.lost = filter.lost;
    let heading = filter.heading;
    let size = start.layout.size();
    let (Some(origin), Some(columns)) = (filter.origin, filter.columns) else {
        let sums = Sums::none(size, varied.len());
        return Ok(Pass { likelihood, shift: DVector::zeros(size), sums });
    };
    let mut shift = origin.shift;
    let [narrow, wide] =
        [&start.covariance, &Start::wide(case, noise).covariance].map(|known| heading.out_of(known));
    let sums = columns.sums().widened(&mut shift, &origin.own, &narrow, &wide);
    Ok(Pass { likelihood, shift, sums })
}
