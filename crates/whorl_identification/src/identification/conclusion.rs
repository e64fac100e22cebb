//! A fit in the user's units, with its uncertainty.

use nalgebra::{DMatrix, SymmetricEigen};
use whorl_dynamics::ModelPrior;
use whorl_prediction::Fitted;
use whorl_recording::Recording;

use super::findings;
use super::parameters::{Free, Kind, Parameters};
use super::{Determined, Identification, IdentifiedParameter};
use crate::finding::Finding;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, MassCovariance, MassVector, inertia_b_kg_m2};
use whorl_dynamics::realisability::smallest_density_moment_kg_m2;

/// A fit that has ended.
pub(super) struct Fit<'a> {
    pub parameters: Parameters<'a>,
    pub prior: &'a ModelPrior,
    pub fitted: Fitted,
    /// Prediction errors with the given model, and with what was identified.
    pub errors: (Option<f64>, Option<f64>),
    pub recordings: &'a [Recording],
    pub findings: Vec<Finding>,
}

pub(super) fn conclude(fit: &Fit<'_>) -> Identification {
    let (parameters, at) = (&fit.parameters, &fit.fitted.at);
    let free = &parameters.free;
    // Data do not take away what was known before them.
    let stddev_units = fit.fitted.covariance.diagonal().map(|v| v.max(0.0).sqrt().min(1.0));
    let covariance = of_mass(&fit.fitted.covariance, free, &|_| true);
    let known = known_actuators(&fit.fitted.covariance, free);
    let prior_stddev = parameters.prior_stddev;
    let stddev = covariance.diagonal().map(f64::sqrt);
    let determined = std::array::from_fn(|i| Determined::of(stddev[i], prior_stddev[i]));
    let (singular_values, combinations) = informed(&covariance, &prior_stddev);
    let (found, estimate) = (parameters.mass_at(at), parameters.body_at(at));
    let moved = smallest_density_moment_kg_m2(&inertia_b_kg_m2(&found)) < 0.0;
    let beside = |kinds: &[Kind]| -> Vec<IdentifiedParameter> {
        let all = free.iter().enumerate().filter(|(_, free)| kinds.contains(&free.kind));
        let described = |(n, free): (usize, &Free)| {
            let (effect, spec) = free.of.as_ref()?;
            Some(IdentifiedParameter {
                effect: effect.info().id,
                name: spec.name.clone(),
                unit: spec.unit,
                before: free.given,
                value: free.value(at[n]),
                stddev: stddev_units[n] * free.stddev,
                prior_stddev: free.stddev,
                determined: Determined::of(stddev_units[n], 1.0),
                // An effect that is not there stays where it was: at none.
                at_bound: fit.fitted.at_bound.get(n) == Some(&true) && at[n] != 0.0,
            })
        };
        all.filter_map(described).collect()
    };
    let (effects, actuators) = (beside(&[Kind::OfModel, Kind::Beside]), beside(&[Kind::Actuator]));
    let mut all = fit.findings.clone();
    all.extend(findings::of_errors(fit.errors));
    if moved {
        let misses = (estimate - found).component_div(&stddev.map(|s| s.max(f64::MIN_POSITIVE))).amax();
        all.push(Finding {
            fatal: misses > 4.0,
            text: format!("No rigid body has the inertia that fits best; the nearest possible one was taken, {misses:.1} standard deviations away."),
        });
    }
    all.extend(findings::of_ends(effects.iter().chain(&actuators)));
    all.extend(findings::of_excitation(&determined, &prior_stddev, &stddev));
    let before = parameters.mass_at(&vec![0.0; at.len()]);
    all.extend(findings::of_prior(&(estimate - before), &prior_stddev, &determined));
    all.sort_by_key(|f| !f.fatal);
    Identification {
        estimate,
        covariance,
        stddev_known_actuators: known.diagonal().map(f64::sqrt),
        prior_stddev,
        determined,
        singular_values,
        combinations,
        effects,
        actuators,
        error_before: fit.errors.0,
        error_after: fit.errors.1,
        gain_nats: gain(&fit.fitted),
        duration_s: fit.recordings.iter().map(Recording::duration_s).sum(),
        moved_to_realisable: moved,
        findings: all,
        updated: parameters
            .written(at)
            .map(|model| (model, parameters.known_after(fit.prior, &stddev_units))),
    }
}

/// What the recordings gain: without what the prior takes from values that are far from it.
fn gain(fitted: &Fitted) -> f64 {
    let pulled: f64 = fitted.at.iter().map(|units| 0.5 * units * units).sum();
    fitted.log_posterior + pulled - fitted.log_posterior_before
}

/// The block of the nine of a covariance in units; zero where one is not fitted.
fn of_mass(covariance: &DMatrix<f64>, free: &[Free], takes: &dyn Fn(usize) -> bool) -> MassCovariance {
    let mut block = MassCovariance::zeros();
    for (n, a) in free.iter().enumerate().filter(|(n, _)| takes(*n)) {
        for (m, b) in free.iter().enumerate().filter(|(m, _)| takes(*m)) {
            if let (Kind::Mass(i), Kind::Mass(j)) = (a.kind, b.kind) {
                block[(i, j)] = covariance[(n, m)] * a.stddev * b.stddev;
            }
        }
    }
    block
}

/// The same with the actuators held where they are.
fn known_actuators(covariance: &DMatrix<f64>, free: &[Free]) -> MassCovariance {
    let kept: Vec<usize> = (0..free.len()).filter(|n| free[*n].kind != Kind::Actuator).collect();
    let Some(information) = covariance.clone().cholesky().map(|factor| factor.inverse()) else {
        return of_mass(covariance, free, &|_| true);
    };
    let own = information.select_rows(&kept).select_columns(&kept);
    let Some(own) = own.cholesky().map(|factor| factor.inverse()) else {
        return of_mass(covariance, free, &|_| true);
    };
    let mut whole = DMatrix::zeros(free.len(), free.len());
    for (a, n) in kept.iter().enumerate() {
        for (b, m) in kept.iter().enumerate() {
            whole[(*n, *m)] = own[(a, b)];
        }
    }
    of_mass(&whole, free, &|n| free[n].kind != Kind::Actuator)
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
