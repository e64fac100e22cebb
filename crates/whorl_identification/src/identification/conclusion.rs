//! A fit as a statement about the nine mass properties.

use nalgebra::{DMatrix, SymmetricEigen};
use whorl_dynamics::effects::BasePrior;
use whorl_dynamics::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, mass_vector, prior_stddev,
};
use whorl_prediction::Fitted;
use whorl_recording::Recording;

use super::{Determined, Identification, findings};
use crate::case::Case;
use crate::fitting::refit::{Fit, FittedParameter, Refit};
use crate::parameter_space::{Column, Reference, Target, is_base};
use whorl_recording::Finding;

/// What a fitted parameter is of a platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One of the nine, by its position.
    Mass(usize),
    /// A parameter of an effect that the model has.
    OfEffect,
    /// A correction of a constant of wheels, jets or gyros.
    Actuator,
}

impl Kind {
    fn of(column: &Column, reference: &Reference) -> Self {
        let element = |row: usize, column: usize| match (row.min(column), row.max(column)) {
            (0, column) => Self::Mass(column),
            (1, column) => Self::Mass(2 + column),
            _ => Self::Mass(5),
        };
        let effect = match column.target {
            Target::Moment(axis) => return element(axis, axis),
            Target::Effect(effect) => effect,
        };
        if !is_base(column.group) || reference.model.effects.contains_key(column.group) {
            return Self::OfEffect;
        }
        match effect.parameters(&reference.model).get(column.index).and_then(|spec| spec.base) {
            Some(BasePrior::Inertia(row, column)) => element(row, column),
            Some(BasePrior::GravityOffset(axis)) => Self::Mass(6 + axis),
            _ => Self::Actuator,
        }
    }
}

pub(super) fn conclude(
    case: &Case<'_>,
    refit: &Refit<'_>,
    fitted: &Fitted,
    fit: Fit,
    errors: (Option<f64>, Option<f64>),
    mut found: Vec<Finding>,
) -> Identification {
    let kinds: Vec<Kind> = refit.columns.iter().map(|column| Kind::of(column, refit.reference)).collect();
    let in_units = covariance(&fit.estimates, fitted);
    let covariance = of_mass(&in_units, &kinds);
    let known_actuators = known_actuators(&in_units, &kinds);
    let is_fitted = |i: usize| kinds.contains(&Kind::Mass(i));
    let of_prior = prior_stddev(&refit.reference.prior);
    let prior_stddev = MassVector::from_fn(|i, _| if is_fitted(i) { of_prior[i] } else { 0.0 });
    let stddev = covariance.diagonal().map(f64::sqrt);
    let determined = std::array::from_fn(|i| Determined::of(stddev[i], prior_stddev[i]));
    let (singular_values, combinations) = informed(&covariance, &prior_stddev);
    let of_kind = |wanted: Kind| -> Vec<FittedParameter> {
        let all = fit.estimates.iter().zip(&kinds).filter(|(_, kind)| **kind == wanted);
        // An effect that is not there stays where it was: at none.
        let said = |(p, _): (&FittedParameter, _)| FittedParameter {
            at_bound: p.at_bound && p.estimate != p.before,
            ..p.clone()
        };
        all.map(said).collect()
    };
    let (effects, actuators) = (of_kind(Kind::OfEffect), of_kind(Kind::Actuator));
    let (before, estimate) =
        (mass_vector(&refit.reference.model.mass_properties), mass_vector(&fit.model.mass_properties));
    found.extend(findings::of_errors(errors));
    found.extend(findings::of_ends(effects.iter().chain(&actuators)));
    if fit.is_explained {
        found.extend(findings::of_excitation(&determined, &prior_stddev, &stddev));
    }
    found.extend(findings::of_prior(&(estimate - before), &prior_stddev, &determined));
    found.sort_by_key(|f| !f.fatal);
    Identification {
        estimate,
        covariance,
        stddev_known_actuators: known_actuators.diagonal().map(f64::sqrt),
        prior_stddev,
        determined,
        singular_values,
        combinations,
        effects,
        actuators,
        error_before: errors.0,
        error_after: errors.1,
        gain_nats: gain(refit, fitted),
        duration_s: case.training.iter().map(Recording::duration_s).sum(),
        findings: found,
        fit,
    }
}

/// What the recordings gain: without what the prior takes from values that are far from it.
fn gain(refit: &Refit<'_>, fitted: &Fitted) -> f64 {
    let pulled: f64 =
        fitted.at.iter().zip(&refit.stddevs).map(|(x, stddev)| 0.5 * (x / stddev).powi(2)).sum();
    fitted.log_posterior + pulled - fitted.log_posterior_before
}

/// Covariance of all that was fitted, in their own units, with the deviations that are said of each.
fn covariance(estimates: &[FittedParameter], fitted: &Fitted) -> DMatrix<f64> {
    let posterior = fitted.covariance.diagonal().map(f64::sqrt);
    DMatrix::from_fn(estimates.len(), estimates.len(), |i, j| {
        fitted.covariance[(i, j)] / (posterior[i] * posterior[j]) * estimates[i].stddev * estimates[j].stddev
    })
}

/// The block of the nine; zero where one is not fitted.
fn of_mass(covariance: &DMatrix<f64>, kinds: &[Kind]) -> MassCovariance {
    let mut block = MassCovariance::zeros();
    for (n, a) in kinds.iter().enumerate() {
        for (m, b) in kinds.iter().enumerate() {
            if let (Kind::Mass(i), Kind::Mass(j)) = (a, b) {
                block[(*i, *j)] = covariance[(n, m)];
            }
        }
    }
    block
}

/// The same with the actuators held where they are: C_kk - C_ka C_aa^-1 C_ak.
fn known_actuators(covariance: &DMatrix<f64>, kinds: &[Kind]) -> MassCovariance {
    let of = |actuators: bool| -> Vec<usize> {
        (0..kinds.len()).filter(|n| (kinds[*n] == Kind::Actuator) == actuators).collect()
    };
    let (kept, held) = (of(false), of(true));
    let block = |rows: &[usize], columns: &[usize]| covariance.select_rows(rows).select_columns(columns);
    let mut own = block(&kept, &kept);
    if let Some(factor) = block(&held, &held).cholesky() {
        own -= block(&kept, &held) * factor.solve(&block(&held, &kept));
    }
    of_mass(&own, &kept.iter().map(|n| kinds[*n]).collect::<Vec<_>>())
}

/// Singular values of the data's information over the prior's, and their directions: with the posterior
/// covariance P and the prior's S, those of S^1/2 (P^-1 - S^-1) S^1/2. What is known exactly has none.
fn informed(covariance: &MassCovariance, prior: &MassVector) -> (MassVector, MassCovariance) {
    let scale = MassCovariance::from_diagonal(&prior.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 }));
    let exact = MassCovariance::from_diagonal(&prior.map(|s| if s > 0.0 { 0.0 } else { 1.0 }));
    let scaled = scale * covariance * scale + exact;
    let eigen = SymmetricEigen::new(0.5 * (scaled + scaled.transpose()));
    let mut order: Vec<usize> = (0..MASS_PARAMETERS).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let mut values = MassVector::zeros();
    let mut vectors = MassCovariance::zeros();
    for (to, from) in order.into_iter().enumerate() {
        values[to] = (1.0 / eigen.eigenvalues[from].max(1e-15) - 1.0).max(0.0);
        vectors.set_column(to, &eigen.eigenvectors.column(from));
    }
    (values, vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two numbers known to one beforehand, and a correlation; the third is exact.
    #[test]
    fn singular_values_are_those_of_what_the_data_say() {
        let mut prior = MassVector::zeros();
        (prior[0], prior[4]) = (2.0, 5.0);
        let mut covariance = MassCovariance::zeros();
        // In units: information of the data diag(3, 0) along the first and second.
        (covariance[(0, 0)], covariance[(4, 4)]) = (4.0 / 4.0, 25.0);
        let (values, combinations) = informed(&covariance, &prior);
        assert!((values[0] - 3.0).abs() < 1e-12 && values.rows(1, 8).amax() < 1e-12, "{values}");
        assert!((combinations[(0, 0)].abs() - 1.0).abs() < 1e-12);
    }
}
