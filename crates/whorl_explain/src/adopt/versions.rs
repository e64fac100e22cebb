//! Versions of a model, fitted and compared with the same runs.

use std::collections::BTreeMap;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_identification::{Fit, FittedParameter, Options, fit};

use super::Adoption;
use crate::compare::{ComparedRun, compare, compare_fitted, prediction_error};
use crate::{Case, ExplainError, ProgressCallback, part};

/// Suffix of the names of corrections.
pub const CORRECTION: &str = " (correction)";
/// Name of the version in which only the platform's own parameters were refitted.
pub const BASE: &str = "base refitted";

/// A version of the model with its prediction errors.
#[derive(Debug, Clone)]
pub struct Version {
    /// "as given", "base refitted", "with ...".
    pub name: String,
    /// Effects added to the given model, by their ids.
    pub effects: Vec<String>,
    /// The fit; `None` for the model as given.
    pub fit: Option<Fit>,
    /// Every run compared with it, training runs first.
    pub runs: Vec<ComparedRun>,
}

impl Version {
    /// See [`prediction_error`].
    #[must_use]
    pub fn prediction_error(&self, held_out: bool) -> Option<f64> {
        prediction_error(&self.runs, held_out)
    }
}

/// Prediction errors of all versions, one sentence on training and one on held-out runs.
pub(crate) fn prediction_errors(versions: &[Version]) -> impl Iterator<Item = String> {
    [(false, "training"), (true, "held-out")].into_iter().filter_map(|(held_out, kind)| {
        let error = |v: &Version| Some(format!("{} {:.2}", v.name, v.prediction_error(held_out)?));
        let errors: Vec<String> = versions.iter().filter_map(error).collect();
        let all = errors.join(", ");
        (!all.is_empty()).then(|| format!("Prediction error on {kind} runs, times the noise: {all}."))
    })
}

/// The model as given, with its own parameters refitted, and with each set of effects (ids of the catalogue).
/// What is `ready` is not fitted again. Sets that cannot be fitted are left out.
///
/// # Errors
/// When a run cannot be compared.
pub fn versions(
    case: &Case<'_>,
    sets: &[Vec<String>],
    ready: &BTreeMap<Vec<String>, Fit>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Adoption, ExplainError> {
    let count = (2 + sets.len()) as f64;
    let share = |k: usize| k as f64 / count;
    let runs = compare(case, &mut part(say, 0.0, share(1)))?;
    let given = Version { name: "as given".to_owned(), effects: Vec::new(), fit: None, runs };
    let (mut versions, mut left_out) = (vec![given.clone()], Vec::new());
    for (k, effects) in std::iter::once(&Vec::new()).chain(sets).enumerate() {
        let joined = effects.join(" and ");
        let name = if effects.is_empty() { BASE.to_owned() } else { format!("with {joined}") };
        let own = if effects.is_empty() { "the platform's own parameters" } else { &joined };
        say(share(k + 1), &format!("fitting {own}"));
        let ids: Vec<&str> = effects.iter().map(String::as_str).collect();
        let fitted = match ready.get(effects) {
            Some(fit) => Ok(fit.clone()),
            None => fit(case.training, case.model, case.prior, &ids, options),
        };
        let mut fitted = match fitted {
            Ok(fitted) => fitted,
            Err(error) => {
                left_out.push((name, error));
                continue;
            }
        };
        let mut say = part(say, share(k + 1) + 0.5 / count, share(k + 2));
        let mut runs = compare_fitted(&Case { model: &fitted.model, ..*case }, &fitted.followed, &mut say)?;
        let after = fitted.model.clone();
        fitted.estimates.iter_mut().for_each(|p| as_constant(p, case.model, &after));
        with_ties(&mut fitted);
        // A refit that makes predictions worse is none.
        if effects.is_empty() && prediction_error(&runs, false) > given.prediction_error(false) {
            (fitted.model, runs) = (case.model.clone(), given.runs.clone());
        }
        versions.push(Version { name, effects: effects.clone(), fit: Some(fitted), runs });
    }
    Ok(Adoption { versions, left_out })
}

/// The fit estimates corrections of the platform's constants. They are shown as constants, or marked as
/// corrections.
fn as_constant(parameter: &mut FittedParameter, before: &PlatformModel, after: &PlatformModel) {
    let Some(effect) = find(&parameter.group) else { return };
    let spec = effect.parameters(before).into_iter().find(|spec| spec.name == parameter.name);
    let constants = spec.and_then(|spec| {
        let base = spec.base?;
        base.constant(before, spec.part).zip(base.constant(after, spec.part))
    });
    if let Some(constants) = constants {
        (parameter.before, parameter.estimate) = constants;
    } else if effect.is_base() && !before.effects.contains_key(&parameter.group) {
        parameter.name.push_str(CORRECTION);
    }
}

/// What is known of two parameters that are not told apart takes the place of the first; of the second by itself nothing is.
fn with_ties(fit: &mut Fit) {
    for tie in &fit.ties {
        let [first, second] = &tie.parameters;
        let is = |p: &FittedParameter, (group, name): &(String, String)| p.group == *group && p.name == *name;
        fit.estimates.retain(|p| !is(p, second));
        if let Some(p) = fit.estimates.iter_mut().find(|p| is(p, first)) {
            (p.name, p.estimate) = (tie.combination(), tie.value);
            (p.stddev, p.posterior_stddev) = (tie.stddev, tie.stddev);
        }
    }
}
