//! How far versions of a model are from recorded runs: as given, refitted, with effects; and what adopting effects changes.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::{EffectKind, find};
use whorl_identification::{DiagnosisError, Fit, FittedParameter, Options, Tie, fit};
use whorl_math::three_digits;
use whorl_params::ModelStep;
use whorl_prediction::Followed;
use whorl_recording::{Recording, usable_readings};
use whorl_validation::Comparison;

use crate::{Case, ExplainError, ProgressCallback};

/// Suffix of the names of corrections.
pub const CORRECTION: &str = " (correction)";
/// A prediction error that exceeds the previous one by this factor counts as worse.
const WORSE: f64 = 1.005;
/// Prior standard deviations beyond which a mass property is implausible.
const IMPLAUSIBLE: f64 = 12.0;

/// A run that was compared.
#[derive(Debug, Clone)]
pub struct ComparedRun {
    /// The numbers.
    pub comparison: Comparison,
    /// Whether the run was kept out of every fit.
    pub held_out: bool,
}

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
    pub fn prediction_error(&self, held_out: bool) -> Option<f64> {
        prediction_error(&self.runs, held_out)
    }
}

/// The same runs with the model as given, refitted, and with effects.
#[derive(Debug, Clone)]
pub struct Adoption {
    /// All versions: the model as given first, the one to adopt last.
    pub versions: Vec<Version>,
    /// Candidates that cannot be fitted, with the reason.
    pub left_out: Vec<(String, DiagnosisError)>,
}

/// Prediction error of a model, over all training or all held-out runs; `None` if no run is long enough; 1 = noise alone. It is the root of the
/// mean square of all errors, each over the deviation that the model predicts for it: of every sample of gyro, accelerometer, vector sensors and
/// wheel speeds, over stretches of 10 s (or a quarter of a shorter run), each predicted by the model and the recorded commands alone from what
/// a filter with this model knows at its beginning.
pub fn prediction_error(runs: &[ComparedRun], held_out: bool) -> Option<f64> {
    let asked = runs.iter().filter(|run| run.held_out == held_out);
    whorl_validation::prediction_error(asked.map(|run| &run.comparison))
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

/// Compares every run with the given model, training runs first, on all cores.
///
/// # Errors
/// When a run cannot be compared, with what would help.
pub fn compare(case: &Case<'_>, say: &mut ProgressCallback<'_>) -> Result<Vec<ComparedRun>, ExplainError> {
    say(0.0, "comparing the runs");
    compare_fitted(case, &[])
}

/// The same of a model that was fitted, with the runs as the fit has followed them, as far as it has.
fn compare_fitted(case: &Case<'_>, followed: &[Followed]) -> Result<Vec<ComparedRun>, ExplainError> {
    let compared = |(i, run): (usize, &Recording)| -> Result<ComparedRun, ExplainError> {
        let (usable, left_out) = usable_readings(run, case.model);
        let mut comparison = whorl_validation::compare(&usable, case.model, followed.get(i))?;
        comparison.remarks.extend(left_out);
        Ok(ComparedRun { comparison, held_out: i >= case.training.len() })
    };
    let all: Vec<&Recording> = case.training.iter().chain(case.held_out).collect();
    let results: Vec<_> = all.into_par_iter().enumerate().map(compared).collect();
    // The first error in the order of the runs.
    results.into_iter().collect()
}

/// Compares all runs with the model as given, refitted, and with each set of effects (ids of the catalogue) fitted jointly with its own parameters.
///
/// # Errors
/// When a run cannot be compared. Sets that cannot be fitted are left out.
pub fn adopt(
    case: &Case<'_>,
    sets: &[Vec<String>],
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Adoption, ExplainError> {
    versions(case, sets, &BTreeMap::new(), options, say)
}

/// The same; what is `ready` is not fitted again.
pub(crate) fn versions(
    case: &Case<'_>,
    sets: &[Vec<String>],
    ready: &BTreeMap<Vec<String>, Fit>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Adoption, ExplainError> {
    let runs = compare(case, say)?;
    let given = Version { name: "as given".to_owned(), effects: Vec::new(), fit: None, runs };
    let (mut versions, mut left_out) = (vec![given.clone()], Vec::new());
    for (k, effects) in std::iter::once(&Vec::new()).chain(sets).enumerate() {
        let named = || format!("with {}", effects.join(" and "));
        let name = if effects.is_empty() { "base refitted".to_owned() } else { named() };
        say((k + 1) as f64 / (sets.len() + 2) as f64, &format!("fitting the model {name}"));
        // An effect that is named twice is one.
        let ids = Vec::from_iter(effects.iter().map(String::as_str).collect::<BTreeSet<_>>());
        let known = ready.get(effects).cloned();
        let fitted = known.map_or_else(|| fit(case.training, case.model, case.prior, &ids, options), Ok);
        let fitted = fitted.map_err(|error| left_out.push((name.clone(), error)));
        let Ok(mut fitted) = fitted else { continue };
        let mut runs = compare_fitted(&Case { model: &fitted.model, ..*case }, &fitted.followed)?;
        in_full(&mut fitted, case.model);
        // A refit that makes predictions worse is none.
        if effects.is_empty() && prediction_error(&runs, false) > given.prediction_error(false) {
            (fitted.model, runs) = (case.model.clone(), given.runs.clone());
        }
        versions.push(Version { name, effects: effects.clone(), fit: Some(fitted), runs });
    }
    Ok(Adoption { versions, left_out })
}

/// A fit estimates corrections of the platform's constants: they are shown as constants, or marked as corrections. What is known of two
/// parameters that are not told apart takes the place of the first; of the second by itself nothing is.
fn in_full(fit: &mut Fit, before: &PlatformModel) {
    for p in &mut fit.estimates {
        let Some(effect) = find(&p.group) else { continue };
        let spec = effect.parameters(before).into_iter().find(|spec| spec.name == p.name);
        let base = spec.and_then(|spec| Some((spec.base?, spec.part)));
        let constant = |of: &PlatformModel| base.and_then(|(base, part)| base.constant(of, part));
        if let Some(constants) = constant(before).zip(constant(&fit.model)) {
            (p.before, p.estimate) = constants;
        } else if effect.is_base() && !before.effects.contains_key(&p.group) {
            p.name.push_str(CORRECTION);
        }
    }
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

/// The mass property that a fit has moved farthest, in a sentence, if by more than is plausible. Moments of inertia are a group of their own.
fn implausible(fit: &Fit) -> Option<String> {
    let is_torque = |p: &FittedParameter| {
        let base = find(&p.group).filter(|effect| effect.is_base());
        base.map_or(p.group == "mass_properties", |effect| effect.info().kind == EffectKind::Torque)
    };
    let known = fit.estimates.iter().filter(|p| p.prior_stddev > 0.0 && is_torque(p));
    let moved = known.map(|p| ((p.estimate - p.before).abs() / p.prior_stddev, &p.name));
    let (most, name) = moved.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(most, _)| *most > IMPLAUSIBLE)?;
    Some(format!(
        "the fit moves {name} by {most:.0} standard deviations of what was known: are these data of another platform, or is the \
         excitation too weak to estimate it?"
    ))
}

impl Adoption {
    /// Prediction errors with the model as given and with the last version.
    fn errors(&self, held_out: bool) -> Option<[f64; 2]> {
        let of = |version: Option<&Version>| version?.prediction_error(held_out);
        Some([of(self.versions.first())?, of(self.versions.last())?])
    }

    /// Improvement by each set of effects, in words.
    pub fn answer(&self) -> Vec<String> {
        let mut answer: Vec<String> = prediction_errors(&self.versions).collect();
        let fits = self.versions.iter().filter_map(|version| version.fit.as_ref());
        answer.extend(fits.flat_map(|fit| &fit.ties).map(of_tie));
        let untested = "No held-out run was given: whether other runs are predicted better was not tested.";
        answer.extend(self.errors(true).is_none().then(|| untested.to_owned()));
        answer
    }

    /// A sentence against adopting the last version: it cannot be fitted, predicts held-out or training runs worse, or a mass property moved too far.
    pub fn objection(&self) -> Option<String> {
        let worse = |(held_out, kind): (bool, &str)| {
            let [before, after] = self.errors(held_out).filter(|[before, after]| *after > WORSE * before)?;
            Some(format!("{kind} runs are predicted worse: {before:.3} -> {after:.3} times the noise"))
        };
        let moved = || implausible(self.versions.last()?.fit.as_ref()?);
        let left_out = self.left_out.last().map(|(version, error)| format!("cannot fit {version}: {error}"));
        left_out.or_else(|| worse((true, "held-out"))).or_else(|| worse((false, "training"))).or_else(moved)
    }

    /// The adoption of the last version as a step of the model's history, without number and date.
    pub fn step(&self, provenance: &str) -> ModelStep {
        ModelStep {
            effects: self.versions.last().map(|version| version.effects.clone()).unwrap_or_default(),
            prediction_error: self.errors(false),
            held_out_prediction_error: self.errors(true),
            ..ModelStep::of_source(provenance.to_owned())
        }
    }
}

/// What is known of two parameters that are not told apart, and what would tell them apart.
fn of_tie(tie: &Tie) -> String {
    let [(effect, first), (other, second)] = &tie.parameters;
    let of = if other == effect { effect.clone() } else { format!("{effect} and {other}") };
    let mut apart = [effect, other].into_iter().filter_map(|id| Some(find(id)?.info().separated_by));
    let apart = apart.find(|how| !how.is_empty());
    let apart = apart.map_or_else(String::new, |how| format!(" A run that tells them apart: {how}."));
    let [value, stddev] = [tie.value, tie.stddev].map(three_digits);
    format!(
        "These runs do not tell {first} and {second} of {of} apart. What is known, and adopted, is {} = {value} +- {stddev} {}.{apart}",
        tie.combination(),
        tie.unit,
    )
}
