//! Estimates and intervals of the effects that are named.
//!
//! Which parts of an effect enter was chosen by the data, and the covariance of the chosen fit is too small: it takes
//! the parts that were left out as known to be zero, and which of two like jets leaks as known. So the
//! estimate that is reported averages over the choices, each with its posterior probability (Hoeting et al.,
//! Statistical Science 14, 1999), and a choice holds every parameter of a part, with a prior so wide that it
//! does not pull.

use nalgebra::{DMatrix, DVector};

use crate::diagnosis::ParameterEstimate;
use crate::explanations::candidates::whole_parts;
use crate::explanations::hypothesis::Hypothesis;
use crate::parameters::Column;
use crate::search::Search;

/// Choices with a log evidence farther below the best have no weight.
const NO_WEIGHT: f64 = 9.0;

/// Parameters less likely to be in are not mentioned.
const LEAST_PROBABILITY: f64 = 0.05;

/// Widening of the prior for the estimate: one that fits the effect's size pulls by a tenth of itself, and
/// this by a tenth of that.
const WIDE: f64 = 3.0;

impl Search<'_> {
    /// A column's parameter, from its estimate and standard deviation in units of the column.
    pub(crate) fn estimate_of(&self, column: &Column, units: f64, stddev_units: f64) -> ParameterEstimate {
        let stddev = stddev_units * column.scale;
        ParameterEstimate {
            name: column.name.clone(),
            unit: column.unit.to_owned(),
            estimate: self.problem.reference.counted_from(&self.point, column) + units * column.scale,
            stddev,
            at_bound: column.is_at_bound(units),
            smallest_detectable: 5.0 * stddev,
        }
    }

    /// Parameters of a term of a set, averaged over the ways in which it can enter.
    pub(crate) fn averaged(&self, set: &Hypothesis, at: usize) -> Option<Vec<ParameterEstimate>> {
        let term = set.terms.get(at)?;
        let candidate = self.design.candidates.get(term.candidate)?;
        let column = |i: &usize| self.design.columns.get(*i);
        if term.columns.iter().filter_map(column).any(|c| c.origin.is_some()) {
            return None;
        }
        // What shapes the effect belongs to it: nothing to choose.
        let is_shaped = candidate.options.iter().flatten().filter_map(column).any(|c| c.is_shape);
        let options: Vec<Vec<usize>> = if is_shaped {
            vec![term.columns.clone()]
        } else {
            whole_parts(&candidate.options, &self.design.columns)
        };
        // Noise that is slower or larger than modelled, and the residual of the best set, widen all intervals.
        let left = self.slow_residual().after.max(1.0);
        let widened = left * left;
        let mut choices: Vec<(f64, Hypothesis)> = Vec::new();
        for columns in options {
            let with = |size: f64| {
                let mut terms = set.terms.clone();
                let slot = terms.get_mut(at)?;
                (slot.columns, slot.size) = (columns.clone(), size);
                Hypothesis::of(&self.design, &self.data.total, terms)
                    .filter(|h| h.terms.len() == set.terms.len())
            };
            let evidence = [0.3, 1.0, 3.0]
                .into_iter()
                .filter_map(|factor| with(factor * term.size))
                .map(|h| h.log_evidence)
                .fold(f64::NEG_INFINITY, f64::max);
            let mut terms = set.terms.clone();
            if let Some(slot) = terms.get_mut(at) {
                (slot.columns, slot.size) = (columns.clone(), WIDE * term.size);
            }
            // Signs are kept below, as what they are: knowledge about the values.
            let wide = Hypothesis::free(&self.design, &self.data.total, terms);
            if let Some(wide) = wide.filter(|_| evidence.is_finite()) {
                choices.push((evidence, wide));
            }
        }
        let best = choices.iter().map(|c| c.0).fold(f64::NEG_INFINITY, f64::max);
        choices.retain(|c| c.0 > best - NO_WEIGHT);
        let sum: f64 = choices.iter().map(|c| (c.0 - best).exp()).sum();
        // Of every column: probability to be in, mean, mean square.
        let mut moments = vec![(0.0, 0.0, 0.0); self.design.columns.len()];
        for (evidence, fit) in &choices {
            let probability = (evidence - best).exp() / sum;
            let own = fit.terms.get(at).map_or(&[][..], |m| m.columns.as_slice());
            let (mut mean, mut covariance) =
                (fit.estimate.value.clone(), fit.estimate.covariance() * widened);
            for (position, i) in fit.estimate.active.iter().enumerate() {
                let signed =
                    column(i).is_some_and(|c| c.base_stddev == 0.0 && c.range.0 > -1e-9 && !c.is_shape);
                if signed && fit.terms.iter().any(|m| m.columns.contains(i)) {
                    truncate(&mut mean, &mut covariance, position);
                }
            }
            for (position, i) in fit.estimate.active.iter().enumerate() {
                // A part that did not enter may still move within the platform's own prior.
                let value = mean[position];
                let variance = covariance[(position, position)].max(0.0);
                let slot = &mut moments[*i];
                slot.0 += if own.contains(i) { probability } else { 0.0 };
                slot.1 += probability * value;
                slot.2 += probability * (value * value + variance);
            }
        }
        let mut parameters = Vec::new();
        for (column, (probability, mean, square)) in self.design.columns.iter().zip(moments) {
            if probability < LEAST_PROBABILITY {
                continue;
            }
            parameters.push(self.estimate_of(column, mean, (square - mean * mean).max(0.0).sqrt()));
        }
        (!parameters.is_empty()).then_some(parameters)
    }
}

/// Mean and covariance of a normal law of which one variable is known not to be negative.
fn truncate(mean: &mut DVector<f64>, covariance: &mut DMatrix<f64>, at: usize) {
    let variance = covariance[(at, at)];
    if variance <= 0.0 {
        return;
    }
    let stddev = variance.sqrt();
    let alpha = -mean[at] / stddev;
    let hazard = normal_hazard(alpha);
    let row: DVector<f64> = covariance.column(at).into_owned();
    *mean += &row * (hazard / stddev);
    let lost = (hazard * (hazard - alpha)).clamp(0.0, 1.0);
    *covariance -= &row * row.transpose() * (lost / variance);
}

/// Density of the standard normal law at `x` over its tail beyond.
fn normal_hazard(x: f64) -> f64 {
    if x > 1.0 {
        // Laplace's continued fraction of the Mills ratio.
        return (1..=60).rev().fold(x, |below, k| x + f64::from(k) / below);
    }
    let density = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    // Tail by the series of the error function: 1/2 - density (x + x^3/3 + x^5/15 + ...).
    let z = x.max(-6.0);
    let (mut term, mut sum) = (z, z);
    for k in 1..80 {
        term *= z * z / f64::from(2 * k + 1);
        sum += term;
    }
    let own = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    density / (0.5 - own * sum).max(1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hazard_of_the_normal_law() {
        // Tables of the normal law: phi(0) / 0.5, phi(1) / 0.158655, phi(2) / 0.0227501, phi(-1) / 0.841345.
        for (x, expected) in [(0.0, 0.797_885), (1.0, 1.525_135), (2.0, 2.373_216), (-1.0, 0.287_600)] {
            assert!((normal_hazard(x) - expected).abs() < 1e-5, "{x}: {}", normal_hazard(x));
        }
        assert!(normal_hazard(-9.0) < 1e-15 && (normal_hazard(9.0) - 9.1088).abs() < 1e-3);
    }

    #[test]
    fn a_sign_moves_what_is_correlated_with_it() {
        // Independent of the other a half-normal law: mean sqrt(2/pi), variance 1 - 2/pi.
        let mut mean = DVector::from_vec(vec![0.0, 1.0]);
        let mut covariance = DMatrix::from_row_slice(2, 2, &[1.0, -0.8, -0.8, 1.0]);
        truncate(&mut mean, &mut covariance, 0);
        let half = (2.0 / std::f64::consts::PI).sqrt();
        assert!((mean[0] - half).abs() < 1e-9 && (covariance[(0, 0)] - (1.0 - half * half)).abs() < 1e-9);
        assert!((mean[1] - (1.0 - 0.8 * half)).abs() < 1e-9);
        assert!((covariance[(1, 1)] - (1.0 - 0.64 * half * half)).abs() < 1e-9);
    }
}
