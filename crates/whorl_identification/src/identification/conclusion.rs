//! A fit as a statement about the nine mass properties, and what a user must know of it, in sentences.

use whorl_dynamics::effects::BasePrior;
use whorl_dynamics::mass_parameters::{
    MASS_PARAMETERS, MassCovariance, MassVector, NAMES, mass_vector, prior_stddev,
};
use whorl_prediction::Fitted;
use whorl_recording::{Finding, Recording};
use whorl_validation::Comparison;

use super::{Determined, Identification};
use crate::case::Case;
use crate::fitting::refit::{Fit, Refit};
use crate::parameter_space::{Column, Reference, Target};

/// Prediction errors that are so many times what the model says are no consequence of its noise.
const UNEXPLAINED: f64 = 3.0;
/// Prior deviations by which a result is far from what was known.
const FAR: f64 = 4.0;

/// Which of the nine a parameter is; `None`: a parameter of an effect that the model has, or a correction of wheels, jets or gyros.
fn of_mass(column: &Column, reference: &Reference) -> Option<usize> {
    let element = |row: usize, column: usize| [[0, 1, 2], [1, 3, 4], [2, 4, 5]][row][column];
    let effect = match column.target {
        Target::Moment(axis) => return Some(element(axis, axis)),
        Target::Effect(effect) => effect,
    };
    if !effect.is_base() || reference.model.effects.contains_key(column.group) {
        return None;
    }
    match effect.parameters(&reference.model).get(column.index)?.base? {
        BasePrior::Inertia(row, column) => Some(element(row, column)),
        BasePrior::GravityOffset(axis) => Some(6 + axis),
        _ => None,
    }
}

pub(super) fn conclude(
    case: &Case,
    refit: &Refit<'_>,
    fitted: &Fitted,
    fit: Fit,
    errors: (Option<f64>, Option<f64>),
    mut found: Vec<Finding>,
) -> Identification {
    let reference = refit.reference;
    let nine: Vec<Option<usize>> = refit.columns.iter().map(|column| of_mass(column, reference)).collect();
    let (mut covariance, mut prior) = (MassCovariance::zeros(), MassVector::zeros());
    // The correlations of the fit with the deviations that are said of each.
    let share = |n: usize| fit.estimates[n].stddev / fitted.covariance[(n, n)].sqrt();
    for (n, i) in nine.iter().enumerate().filter_map(|(n, i)| Some((n, (*i)?))) {
        prior[i] = prior_stddev(&reference.prior)[i];
        for (m, j) in nine.iter().enumerate().filter_map(|(m, j)| Some((m, (*j)?))) {
            covariance[(i, j)] = fitted.covariance[(n, m)] * share(n) * share(m);
        }
    }
    let stddev = covariance.diagonal().map(f64::sqrt);
    let determined = std::array::from_fn(|i| Determined::of(stddev[i], prior[i]));
    let others = fit.estimates.iter().zip(&nine).filter(|(_, nine)| nine.is_none());
    let others = others.map(|(parameter, _)| parameter.clone()).collect();
    let estimate = mass_vector(&fit.model.mass_properties);
    let moved = estimate - mass_vector(&reference.model.mass_properties);
    if let Some(error) = errors.1.filter(|error| *error > UNEXPLAINED) {
        found.push(Finding::fatal(format!(
            "The model does not explain the measurements: its predictions err {error:.1} times what it says of them. A sign, an axis, a unit or the noise in the model is wrong, or an effect is missing; look with `whorl diagnose` before using these numbers."
        )));
    }
    if fit.is_explained {
        found.extend(of_excitation(&determined, &prior, &stddev));
    }
    let far = (0..MASS_PARAMETERS).filter(|i| determined[*i] == Determined::Yes);
    let far = far.map(|i| (NAMES[i], (moved[i] / prior[i]).abs())).filter(|(_, by)| *by > FAR);
    let far: Vec<String> = far.map(|(name, by)| format!("{name} by {by:.1}")).collect();
    if !far.is_empty() {
        found.push(Finding::warning(format!(
            "Far from what was known before, in its standard deviations: {}. Either the drawing is wrong, or an actuator's sign or strength is.",
            far.join(", ")
        )));
    }
    found.sort_by_key(|finding| !finding.fatal);
    Identification {
        estimate,
        covariance,
        prior_stddev: prior,
        determined,
        others,
        error_before: errors.0,
        error_after: errors.1,
        duration_s: case.training.iter().map(Recording::duration_s).sum(),
        findings: found,
        fit,
    }
}

/// Of the recordings with what was identified, whole or in pieces.
pub(super) fn of_fit(after: &[Comparison], is_explained: bool, stands: bool) -> Vec<Finding> {
    let unexplained = after.iter().filter(|run| run.unexplained.is_some());
    let mut texts: Vec<String> = unexplained
        .map(|run| {
            format!(
                "{}: a torque remains that the model does not have: {}. `whorl diagnose` looks for what it is.",
                run.run, run.unexplained
            )
        })
        .collect();
    if !is_explained {
        texts.push("A random torque remains beside these values. While what it is is missing, the platform's constants are biased by it: they keep the uncertainty that they had.".to_owned());
    }
    if !stands {
        texts.push(
            "The fit has not converged: another run of it from these values may find likelier ones."
                .to_owned(),
        );
    }
    for text in after.iter().flat_map(|run| &run.remarks) {
        // What a recording lacks, all its pieces lack.
        if !texts.contains(text) {
            texts.push(text.clone());
        }
    }
    texts.into_iter().map(Finding::warning).collect()
}

/// Of what the motion did not excite. What is known exactly needs no data.
fn of_excitation(
    determined: &[Determined; MASS_PARAMETERS],
    prior: &MassVector,
    stddev: &MassVector,
) -> Option<Finding> {
    let is_weak = |i: usize| determined[i] == Determined::No && prior[i] > 0.0;
    let weak: Vec<usize> = (0..MASS_PARAMETERS).filter(|i| is_weak(*i)).collect();
    if weak.len() == prior.iter().filter(|stddev| **stddev > 0.0).count() {
        return Some(Finding::fatal(
            "Nothing was excited: these data say nothing about the mass properties; all values are the prior's."
                .to_owned(),
        ));
    }
    let advice = if [2, 4, 5].into_iter().any(is_weak) {
        "Add motion about z: yaw back and forth with the z wheel, quickly."
    } else if [0, 1, 3].into_iter().any(is_weak) {
        "Add motion about x and y: swing in roll and pitch, each with its wheel."
    } else {
        "Hold several tilts in different directions, or let the platform swing freely."
    };
    let said = |i: &usize| format!("{} (uncertainty {:.2} of before)", NAMES[*i], stddev[*i] / prior[*i]);
    let text = weak.iter().map(said).collect::<Vec<_>>().join(", ");
    (!weak.is_empty())
        .then(|| Finding::warning(format!("Not excited, values are the prior's: {text}. {advice}")))
}
