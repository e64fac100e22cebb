//! Laws that nobody listed.
//! Where no effect of the catalogue explains what a model lacks, [`discover`] searches for its law: the unlisted laws of a diagnosis with
//! more terms, all of which have an equation ([`crate::grammar::written()`]). The best become effects, written as data, and are fitted
//! like the model as it is and the catalogue's nearest effects.

mod law;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use serde::Serialize;
use whorl_dynamics::effects::written::{Definition, WrittenEffect};
use whorl_dynamics::effects::{find, register_secret, withdraw};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::case::Case;
use crate::selection::Selection;
use crate::{DiagnosisError, FittedParameter, Options, Outcome};
use law::laws;

/// A parameter of a law, fitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FittedValue {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value where the law fits best.
    pub value: f64,
    /// Its standard deviation.
    pub stddev: f64,
}

/// A law with its weight.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct EvaluatedLaw {
    /// A sentence.
    pub sentence: String,
    /// Its equation; for an effect of the catalogue, that effect's.
    pub equation: String,
    /// `law`, `effect` (of the catalogue) or `nothing` (the model as it is).
    pub kind: &'static str,
    /// Posterior probability among all that was evaluated, 0 to 1.
    pub probability: f64,
    /// Log evidence over the model as it is, log-prior penalties not included.
    pub log_evidence: f64,
    /// Log likelihood gained on held-out runs; `None` without such runs.
    pub held_out_gain: Option<f64>,
    /// Slow random torque that is needed beside it [N m].
    pub background_n_m: f64,
    /// Its parameters.
    pub parameters: Vec<FittedValue>,
    /// Recorded variables that it depends on.
    pub variables: Vec<String>,
    /// The effect to write; `None` for `nothing` and effects of the catalogue.
    #[serde(skip)]
    pub definition: Option<Definition>,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Discovery {
    /// Everything that was evaluated, most probable first.
    pub laws: Vec<EvaluatedLaw>,
    /// Number of laws that were tried in the regression.
    pub tried: usize,
}

impl Discovery {
    /// The most probable law, if one is more probable than nothing and the catalogue.
    pub fn best(&self) -> Option<&EvaluatedLaw> {
        self.laws.first().filter(|law| law.definition.is_some())
    }
}

/// What is evaluated where it fits best: effects of the catalogue, or that of a law for as long as it is evaluated.
struct Candidate {
    effects: Vec<String>,
    log_prior: f64,
    /// With what is known before the fit.
    law: EvaluatedLaw,
}

/// Searches for the law of what the model lacks. `named` are sets of effects of the catalogue that compete with it;
/// `id` becomes the id of the best law.
///
/// # Errors
/// When the recordings cannot be explained at all, or an effect of the catalogue has the id.
#[expect(clippy::too_many_arguments, reason = "the case, and what is asked of it")]
pub fn discover(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    named: &[Vec<String>],
    id: &str,
    options: &Options,
    say: &mut dyn FnMut(f64, &str),
) -> Result<Discovery, DiagnosisError> {
    say(0.0, "fitting the platform's own parameters");
    let case = Case::new(training, held_out, model, prior, options)?;
    let selection = Selection::begun(case.runs(), options)?;
    say(0.1, "trying laws");
    let (mut candidates, tried) = laws(&selection, id)?;
    candidates.extend(named.iter().map(|set| {
        let each = set.iter().filter_map(|id| find(id)).map(|effect| effect.info().equation);
        let law = EvaluatedLaw {
            sentence: format!("The catalogue's {}.", set.join(" and ")),
            equation: each.collect::<Vec<_>>().join("; "),
            kind: "effect",
            ..EvaluatedLaw::default()
        };
        let log_prior = set.len() as f64 * options.settings.present.ln();
        Candidate { effects: set.clone(), log_prior, law }
    }));
    say(0.5, "fitting the best laws");
    let definitions = || candidates.iter().filter_map(|of| of.law.definition.as_ref());
    // What is only tried is in nobody's catalogue.
    let tried_effect =
        |of: &Definition| -> Outcome<_> { Ok(register_secret(WrittenEffect::new(of.clone())?)?) };
    let registered = definitions().try_for_each(|definition| tried_effect(definition).map(drop));
    let laws = registered.and_then(|()| evaluated(&selection, &candidates, id));
    definitions().for_each(|definition| withdraw(&definition.id));
    Ok(Discovery { laws: laws?, tried })
}

/// Each candidate and the model as it is with its probability, most probable first, without those that would have to act against their sign.
fn evaluated(selection: &Selection<'_>, candidates: &[Candidate], id: &str) -> Outcome<Vec<EvaluatedLaw>> {
    let (runs, base) = (&selection.runs, selection.base());
    let unknown = |id: &String| DiagnosisError::UnknownEffect(id.clone());
    let known = |id: &String| Ok(find(id).ok_or_else(|| unknown(id))?.info().id);
    let sets = candidates.iter().map(|of| of.effects.iter().map(known).collect());
    let sets: Vec<Vec<&'static str>> = sets.collect::<Result<_, DiagnosisError>>()?;
    let asked: BTreeSet<&str> = sets.iter().flatten().copied().collect();
    let beside = selection.beside_of(base, asked.into_iter().filter_map(find).collect())?;
    let has_held_out = !runs.held_out.is_empty();
    let nothing = EvaluatedLaw {
        sentence: "The model as it is, with a slow random torque where the data need one.".to_owned(),
        kind: "nothing",
        held_out_gain: has_held_out.then_some(0.0),
        background_n_m: base.torque_n_m(),
        ..EvaluatedLaw::default()
    };
    let mut list = vec![(0.0, nothing)];
    for (candidate, set) in candidates.iter().zip(&sets) {
        let Some(hypothesis) = beside.as_ref().and_then(|beside| beside.with(set)) else { continue };
        let Some(found) = DiagnosisError::possible(runs.evaluate(hypothesis, &[base]))? else { continue };
        let fit = found.fit(runs.reference)?;
        let of_effects = fit.estimates.into_iter().filter(|of| set.iter().any(|id| *id == of.group));
        let value = |of: FittedParameter| FittedValue {
            name: of.name,
            unit: of.unit,
            value: of.estimate,
            stddev: of.posterior_stddev,
        };
        let mut law = EvaluatedLaw {
            log_evidence: found.log_evidence - base.log_evidence + selection.held_out_nats(&found),
            held_out_gain: has_held_out.then(|| selection.held_out_gain(&found)),
            background_n_m: found.torque_n_m(),
            parameters: of_effects.map(value).collect(),
            ..candidate.law.clone()
        };
        law.definition.iter_mut().for_each(|definition| id.clone_into(&mut definition.id));
        list.push((law.log_evidence + candidate.log_prior, law));
    }
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    let largest = list[0].0;
    let sum: f64 = list.iter().map(|(score, _)| (score - largest).exp()).sum();
    list.iter_mut().for_each(|(score, law)| law.probability = (*score - largest).exp() / sum);
    Ok(list.into_iter().map(|(_, law)| law).collect())
}
