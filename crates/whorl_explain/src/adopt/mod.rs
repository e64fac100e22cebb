//! Improvement of the model by a physical effect, and the parameters with which the effect is adopted.

mod versions;

use std::collections::{BTreeMap, BTreeSet};

use whorl_dynamics::effects::{EffectKind, find};
use whorl_identification::{DiagnosisError, Fit, FittedParameter, Options, Tie};
use whorl_math::three_digits;
use whorl_params::ModelStep;

pub(crate) use versions::prediction_errors;
pub use versions::{BASE, CORRECTION, Version, versions};

use crate::changes::{Change, changes};
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
    let mut sets = sets.to_vec();
    for set in &mut sets {
        // An effect that is named twice is one.
        let mut named = BTreeSet::new();
        set.retain(|id| named.insert(id.clone()));
    }
    let adoption = versions(case, &sets, &BTreeMap::new(), options, say)?;
    let may_fail =
        |error: &DiagnosisError| matches!(error, DiagnosisError::NoEffect { .. }) && sets.len() > 1;
    match adoption.left_out.iter().find(|(_, error)| !may_fail(error)) {
        Some((version, error)) => {
            Err(ExplainError::Fit { version: version.clone(), error: Box::new(error.clone()) })
        }
        None => Ok(adoption),
    }
}

/// The constant of the platform, of those that correct one of these kinds, that a fit has moved farthest, in a sentence, if by more than so
/// many prior standard deviations. Moments of inertia are a group of their own among the parameters of a fit.
pub(crate) fn implausible(fit: &Fit, most: f64, of_kind: impl Fn(EffectKind) -> bool) -> Option<String> {
    let is_constant = |p: &&FittedParameter| {
        let effect = find(&p.group).filter(|effect| effect.is_base());
        effect.map_or(p.group == "mass_properties", |effect| of_kind(effect.info().kind))
    };
    let constants = fit.estimates.iter().filter(|p| p.prior_stddev > 0.0).filter(is_constant);
    let moved = constants.map(|p| (p, (p.estimate - p.before).abs() / p.prior_stddev));
    let (worst, stddevs) = moved.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, stddevs)| *stddevs > most)?;
    Some(format!(
        "the fit asks for {} = {} {}, and the model says {} +- {}: {stddevs:.0} standard deviations",
        worst.name,
        three_digits(worst.estimate),
        worst.unit,
        three_digits(worst.before),
        three_digits(worst.prior_stddev),
    ))
}

impl Adoption {
    /// Improvement by each set of effects, in words.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let mut answer: Vec<String> = prediction_errors(&self.versions).collect();
        let has_held_out = self.versions.iter().flat_map(|version| &version.runs).any(|run| run.held_out);
        let base = self.versions.iter().find(|version| version.name == BASE);
        let base = base.and_then(|base| base.prediction_error(has_held_out));
        for version in self.versions.iter().filter(|version| !version.effects.is_empty()) {
            answer.extend(version.fit.iter().flat_map(|fit| &fit.ties).map(of_tie));
            let errors = base.zip(version.prediction_error(has_held_out));
            if let Some((a, b)) = errors.filter(|(a, b)| *b > a / WORSE) {
                answer.push(format!(
                    "Refitting inertia, centre of mass and actuators alone does as well ({a:.3} against {b:.3}): these data do not \
                     support {}.",
                    version.effects.join(" and ")
                ));
            }
        }
        if !has_held_out {
            answer.push(
                "No held-out run was given: whether the model predicts other runs better was not tested."
                    .to_owned(),
            );
        }
        answer
    }

    /// An objection to adopting the last version, as a sentence: held-out or training runs are predicted worse, or a mass
    /// property has moved implausibly far.
    #[must_use]
    pub fn objection(&self) -> Option<String> {
        let (first, last) = (self.versions.first()?, self.versions.last()?);
        for (held_out, kind) in [(true, "held-out"), (false, "training")] {
            let (before, after) = (first.prediction_error(held_out), last.prediction_error(held_out));
            if let Some((before, after)) = before.zip(after).filter(|(before, after)| *after > WORSE * before)
            {
                return Some(format!(
                    "the {kind} runs are predicted worse with it ({before:.3} -> {after:.3} times the noise)"
                ));
            }
        }
        let moved = implausible(last.fit.as_ref()?, IMPLAUSIBLE, |kind| kind == EffectKind::Torque)?;
        Some(format!(
            "{moved}. Are these data of another platform? Or is the excitation too weak to estimate it: add a run with more motion"
        ))
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
        let fit = self.versions.last().and_then(|version| version.fit.as_ref());
        fit.map_or_else(Vec::new, |fit| {
            changes((case.model, &fit.model), (case.prior, &fit.prior), provenance)
        })
    }
}

/// What is known of two parameters that are not told apart, and what would tell them apart.
fn of_tie(tie: &Tie) -> String {
    let [(effect, first), (other, second)] = &tie.parameters;
    let apart =
        [effect, other].into_iter().filter_map(|id| find(id)).map(|effect| effect.info().separated_by);
    let apart = { apart }.find(|how| !how.is_empty());
    let apart = apart.map_or_else(String::new, |how| format!(" A run that tells them apart: {how}."));
    let of = if other == effect {
        format!("{first} and {second} of {effect}")
    } else {
        format!("{first} of {effect} and {second} of {other}")
    };
    format!(
        "These runs do not tell {of} apart. What is known, and adopted, is {} = {} +- {} {}; either alone is known to +- {} only.{apart}",
        tie.combination(),
        three_digits(tie.value),
        three_digits(tie.stddev),
        tie.unit,
        three_digits(tie.stddevs[0].min(tie.stddevs[1])),
    )
}
