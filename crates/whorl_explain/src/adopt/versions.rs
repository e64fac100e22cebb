//! Versions of a model, fitted and compared with the same runs.

use std::cell::OnceCell;
use std::collections::BTreeMap;

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_identification::{DiagnosisError, Fit, FittedParameter, Fitter, Options};

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

/// Versions of the model, and the sets of effects that could not be fitted, each with the reason.
pub type Compared = (Vec<Version>, Vec<(String, DiagnosisError)>);

/// The model as given, with its own parameters refitted, and with each set of effects (ids of the catalogue).
/// What is `ready` is not fitted again. Sets that cannot be fitted are returned second, with the reason.
///
/// # Errors
/// When a run cannot be compared.
pub fn versions(
    case: &Case<'_>,
    sets: &[Vec<String>],
    ready: &BTreeMap<Vec<String>, Fit>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Compared, ExplainError> {
    let count = (2 + sets.len()) as f64;
    let share = |k: usize| k as f64 / count;
    let given = compare(case, &mut part(say, 0.0, share(1)))?;
    let mut versions =
        vec![Version { name: "as given".to_owned(), effects: Vec::new(), fit: None, runs: given }];
    let fitter = OnceCell::new();
    let fitter = || fitter.get_or_init(|| Fitter::new(case.training, case.model, case.prior, options));
    let none = Vec::new();
    let mut left_out = Vec::new();
    for (k, effects) in std::iter::once(&none).chain(sets).enumerate() {
        let joined = effects.join(" and ");
        let (name, doing) = if effects.is_empty() {
            (BASE.to_owned(), "fitting the platform's own parameters".to_owned())
        } else {
            (format!("with {joined}"), format!("fitting {joined}"))
        };
        say(share(k + 1), &doing);
        let ids: Vec<&str> = effects.iter().map(String::as_str).collect();
        let fitted = match ready.get(effects) {
            Some(fit) => Ok(fit.clone()),
            None => fitter().as_ref().map_err(Clone::clone).and_then(|fitter| fitter.fit(&ids)),
        };
        let mut fitted = match fitted {
            Ok(fitted) => fitted,
            Err(error) => {
                left_out.push((name, error));
                continue;
            }
        };
        let after = fitted.model.clone();
        fitted.estimates.iter_mut().for_each(|p| say_in_full(p, case.model, &after));
        say_together(&mut fitted);
        let compared = part(say, share(k + 1) + 0.5 / count, share(k + 2));
        let mut runs = compare_fitted(&case.with_model(&after), &fitted.followed, &mut { compared })?;
        // What makes predictions worse stays as it was given.
        let is_worse = |runs: &[ComparedRun], given: &Version| {
            prediction_error(runs, false)
                .zip(given.prediction_error(false))
                .is_some_and(|(now, was)| now > was)
        };
        if let Some(given) = versions.first().filter(|given| effects.is_empty() && is_worse(&runs, given)) {
            (fitted.model, runs) = (case.model.clone(), given.runs.clone());
        }
        versions.push(Version { name, effects: effects.clone(), fit: Some(fitted), runs });
    }
    Ok((versions, left_out))
}

/// The fit estimates corrections of the platform's constants. They are shown as constants, or marked as
/// corrections.
fn say_in_full(parameter: &mut FittedParameter, before: &PlatformModel, after: &PlatformModel) {
    let spec = find(&parameter.group)
        .and_then(|effect| effect.parameters(before).into_iter().find(|spec| spec.name == parameter.name));
    let constants = spec.and_then(|spec| {
        let base = spec.base?;
        base.constant(before, spec.part).zip(base.constant(after, spec.part))
    });
    if let Some((before, after)) = constants {
        (parameter.before, parameter.estimate) = (before, after);
    } else if find(&parameter.group).is_some_and(|effect| effect.is_base())
        && !before.effects.contains_key(&parameter.group)
    {
        parameter.name.push_str(CORRECTION);
    }
}

/// What is known of two parameters that are not told apart takes the place of the first; of the second by itself nothing is.
fn say_together(fit: &mut Fit) {
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

/// The gyro axis with the largest error over the longest horizon before: its name, seconds, and each version's RMS with the
/// deviation that it predicts \[deg/s\].
pub fn worst_gyro(versions: &[Version], held_out: bool) -> Option<(String, f64, Vec<[f64; 2]>)> {
    let of = |version: &Version, name: &str| -> Option<(f64, [f64; 2])> {
        let channels =
            version.runs.iter().filter(|r| r.held_out == held_out).flat_map(|r| &r.comparison.channels);
        let longest: Vec<(f64, [f64; 2])> = channels
            .filter(|c| c.name == name)
            .filter_map(|c| c.horizons.iter().rev().find_map(|h| Some((h.horizon_s?, h))))
            .map(|(horizon_s, h)| (horizon_s, [h.rms, h.predicted_stddev]))
            .collect();
        let mean = |i: usize| {
            let squares = longest.iter().map(|(_, of)| of[i] * of[i]).sum::<f64>();
            whorl_math::deg_from_rad((squares / longest.len() as f64).sqrt())
        };
        let horizon_s = longest.iter().map(|(horizon_s, _)| *horizon_s).reduce(f64::max)?;
        Some((horizon_s, [mean(0), mean(1)]))
    };
    let first = versions.first()?;
    let (name, (horizon_s, _)) = ["gyro_x", "gyro_y", "gyro_z"]
        .into_iter()
        .filter_map(|n| of(first, n).map(|e| (n, e)))
        .max_by(|(_, (_, a)), (_, (_, b))| a[0].total_cmp(&b[0]))?;
    let all = versions.iter().map(|v| of(v, name).map_or([f64::NAN; 2], |(_, of)| of)).collect();
    Some((name.to_owned(), horizon_s, all))
}
