//! Improvement of the model by a physical effect, and the parameters with which the effect is adopted.

mod versions;
mod words;

use std::collections::BTreeMap;

use whorl_dynamics::effects::{EffectKind, find};
use whorl_identification::{DiagnosisError, Fit, FittedParameter, Options};
use whorl_math::three_digits;
use whorl_params::{ModelStep, Value};

pub use versions::{BASE, CORRECTION, Version, versions};

use crate::changes::{Change, changes, rounded};
use crate::{Case, ExplainError, ProgressCallback};

/// A prediction error that exceeds the previous one by this factor counts as worse.
pub const WORSE: f64 = 1.005;
/// Prior standard deviations beyond which a mass property is implausible.
const IMPLAUSIBLE: f64 = 12.0;

/// The same runs with the model as given, refitted, and with effects.
#[derive(Debug, Clone)]
pub struct Adoption {
    /// All versions: the model as given first, the one to adopt last.
    pub versions: Vec<Version>,
    /// Candidates that cannot be fitted, with the reason.
    pub left_out: Vec<(String, DiagnosisError)>,
}

/// Fits each set of effects jointly with the platform's own parameters, and compares all runs with each version.
///
/// # Errors
/// When a run cannot be compared; when a version cannot be fitted, unless it is an effect that these data do not show
/// and there are other candidates.
pub fn adopt(
    case: &Case<'_>,
    sets: &[Vec<String>],
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Adoption, ExplainError> {
    let sets: Vec<Vec<String>> = sets.iter().map(|set| each_once(set)).collect();
    let (versions, left_out) = versions(case, &sets, &BTreeMap::new(), options, say)?;
    let is_rival =
        |error: &DiagnosisError| matches!(error, DiagnosisError::NoEffect { .. }) && sets.len() > 1;
    match left_out.iter().find(|(_, error)| !is_rival(error)) {
        Some((version, error)) => Err(ExplainError::Fit { version: version.clone(), error: error.clone() }),
        None => Ok(Adoption { versions, left_out }),
    }
}

/// Moments of inertia are a group of their own among the parameters of a fit; what else is a constant of the platform corrects it as an effect.
fn is_constant(parameter: &FittedParameter, of_kind: impl Fn(EffectKind) -> bool) -> bool {
    let effect = find(&parameter.group).filter(|effect| effect.is_base());
    effect.map_or(parameter.group == "mass_properties", |effect| of_kind(effect.info().kind))
}

/// The constant of the platform among these that a fit has moved farthest, and by how many prior standard deviations.
pub(crate) fn farthest(fit: &Fit, of_kind: impl Fn(EffectKind) -> bool) -> Option<(&FittedParameter, f64)> {
    let constants = fit.estimates.iter().filter(|p| p.prior_stddev > 0.0 && is_constant(p, &of_kind));
    let moved = constants.map(|p| (p, (p.estimate - p.before).abs() / p.prior_stddev));
    moved.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// An effect that is named twice is one.
fn each_once(set: &[String]) -> Vec<String> {
    let is_new = |k: usize| !set.iter().take(k).any(|before| Some(before) == set.get(k));
    set.iter().enumerate().filter(|(k, _)| is_new(*k)).map(|(_, effect)| effect.clone()).collect()
}

impl Adoption {
    /// An objection to adopting the last version, as a sentence: held-out or training runs are predicted worse, or a mass
    /// property has moved implausibly far.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        let (first, last) = (self.versions.first()?, self.versions.last()?);
        for (held_out, kind) in [(true, "held-out"), (false, "training")] {
            if let (Some(before), Some(after)) =
                (first.prediction_error(held_out), last.prediction_error(held_out))
                && after > WORSE * before
            {
                return Some(format!(
                    "the {kind} runs are predicted worse with it ({before:.3} -> {after:.3} times the noise)"
                ));
            }
        }
        let (worst, stddevs) = farthest(last.fit.as_ref()?, |kind| kind == EffectKind::Torque)?;
        (stddevs > IMPLAUSIBLE).then(|| {
            format!(
                "the fit asks for {} = {} {}, and the model says {} +- {}: {stddevs:.0} standard deviations. Are these data of \
                 another platform? Or is the excitation too weak to estimate it: add a run with more motion",
                worst.name,
                three_digits(worst.estimate),
                worst.unit,
                three_digits(worst.before),
                three_digits(worst.prior_stddev),
            )
        })
    }

    /// The adoption of the last version as a step of the model's history, without number and date.
    #[must_use]
    pub fn step(&self, provenance: &str) -> ModelStep {
        let (first, last) = (self.versions.first(), self.versions.last());
        let errors =
            |held_out: bool| Some([first?.prediction_error(held_out)?, last?.prediction_error(held_out)?]);
        ModelStep {
            effects: last.map(|version| version.effects.clone()).unwrap_or_default(),
            prediction_error: errors(false),
            held_out_prediction_error: errors(true),
            ..ModelStep::of_source(provenance.to_owned())
        }
    }

    /// Entries of the parameter file in which the last version differs from the model as given; `provenance` names
    /// the source of the numbers.
    #[must_use]
    pub fn changes(&self, case: &Case<'_>, provenance: &str) -> Vec<Change> {
        let fit = self.versions.last().and_then(|v| v.fit.as_ref());
        fit.map_or_else(Vec::new, |fit| {
            let mut changes = changes((case.model, &fit.model), (case.prior, &fit.prior), provenance);
            for tie in &fit.ties {
                for (effect, name) in &tie.parameters {
                    let key = format!("model.effects.{effect}.{name}");
                    let Some(change) = changes.iter_mut().find(|change| change.key == key) else { continue };
                    // The combination is known better than either.
                    let value = fit.model.effects.get(effect).and_then(|values| values.get(name));
                    change.value = Value::Double(rounded(value.copied().unwrap_or(0.0), tie.stddev));
                    change.comment = format!(
                        "[{}] {} +- {}, adopted; not told apart",
                        tie.unit,
                        tie.combination(),
                        three_digits(tie.stddev)
                    );
                }
            }
            changes
        })
    }
}
