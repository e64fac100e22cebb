//! Laws that nobody listed.
//!
//! Where a model lacks something that no effect of the catalogue explains, [`discover`] searches for its law: terms of
//! recorded variables (powers, signs, saturations, dead zones, products, lags) about axes of body or room, along the rate,
//! or on the wheels, up to three together. Every term is a column of the causal filter by which a diagnosis evaluates everything, so it
//! competes under the same evidence as the catalogue's effects, beside the platform's own parameters; every symbol has a log-prior penalty (`grammar/terms.rs`). The best become effects of the catalogue, written as data, and
//! are evaluated where each fits best, together with the model as it is, the catalogue's nearest effects, and a measured curve
//! for where there is no law.

mod bench;
mod law;
mod search;
mod signals;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;
use serde::Serialize;
use whorl_dynamics::effects::written::{Definition, DefinitionError, Formula, WrittenEffect};
use whorl_dynamics::effects::{RegisterError, find, register, withdraw};
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::Push;
use whorl_recording::Recording;

use crate::case::Case;
use crate::grammar::terms;
use crate::grammar::variable::{Recorded, Variable, moving, possible};
use crate::{DiagnosisError, Options};
use bench::{Bench, FittedLaw};
use law::{Law, curve_of, law_of};
use search::{Ground, proposals};

/// Laws that are evaluated where each fits best.
const EVALUATED: usize = 5;

/// Log prior of something unmodelled, of an effect of the catalogue, as in the diagnosis.
const UNMODELLED: f64 = 0.01;
const PRESENT: f64 = 0.005;

/// Bins of the measured points that are drawn with a law.
const DRAWN: usize = 12;

/// Why nothing was searched.
#[derive(Debug, thiserror::Error)]
pub enum DiscoveryError {
    /// The recordings cannot be explained at all.
    #[error(transparent)]
    Diagnosis(#[from] DiagnosisError),
    /// A term that was made is no equation.
    #[error("a term of the search is wrong: {0}")]
    Term(#[from] DefinitionError),
    /// An effect of the catalogue has the id of a law that was found.
    #[error(transparent)]
    Taken(#[from] RegisterError),
}

/// A parameter of a law, fitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FittedValue {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Value where the law fits best.
    pub value: f64,
}

/// A law with its weight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EvaluatedLaw {
    /// A sentence.
    pub sentence: String,
    /// Its equation; for an effect of the catalogue, that effect's.
    pub equation: String,
    /// `law`, `curve` (measured, not understood), `effect` (of the catalogue) or `nothing` (the model as it is).
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

/// A measured point of the torque that a law explains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DrawnPoint {
    /// The variable, in its unit.
    pub at: f64,
    /// Torque [N m].
    pub torque_n_m: f64,
    /// Its standard deviation [N m].
    pub stddev_n_m: f64,
    /// What the best law says there [N m]; `None` where it has several terms.
    pub law_n_m: Option<f64>,
}

/// The best law over the data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Drawn {
    /// The variable, in words, with its unit.
    pub variable: String,
    /// The direction, in words.
    pub direction: String,
    /// Points, by the variable.
    pub points: Vec<DrawnPoint>,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Discovery {
    /// Everything that was evaluated, most probable first.
    pub laws: Vec<EvaluatedLaw>,
    /// Number of laws that were tried in the regression.
    pub tried: usize,
    /// The best law over the data, where it is a function of one variable.
    pub drawn: Option<Drawn>,
}

impl Discovery {
    /// The most probable law or curve, if one is more probable than nothing and the catalogue.
    #[must_use]
    pub fn best(&self) -> Option<&EvaluatedLaw> {
        self.laws.first().filter(|law| law.definition.is_some())
    }
}

/// Searches for the law of what the model lacks. `named` are sets of effects of the catalogue that compete with it;
/// `id` becomes the id of the best law.
///
/// # Errors
/// When the recordings cannot be explained at all.
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
) -> Result<Discovery, DiscoveryError> {
    say(0.0, "fitting the platform's own parameters");
    let case = Case::new(training, held_out, model, prior, options)?;
    let bench = Bench::new(case.runs(), options)?;
    let recorded = Recorded::of(training.iter().chain(held_out));
    let possible = possible(model, &recorded);
    let seen = bench.over_runs(&vec![0.0_f64; possible.len()], |largest, environment, _| {
        for (largest, variable) in largest.iter_mut().zip(&possible) {
            *largest = largest.max(variable.number(environment).abs());
        }
    })?;
    let variables = moving(possible, &seen);
    let ground = Ground {
        bench: &bench,
        largest_rate_rad_s: variables.iter().find(|v| v.text == "norm(rate)").map_or(0.0, |v| v.largest),
        variables,
        wheels: model.wheels().len(),
        run_s: bench.shortest_s(),
    };
    let (proposed, tried) = proposals(&ground, &mut |share, doing| say(0.1 + 0.4 * share, doing))?;
    let mut laws: Vec<Law> = Vec::new();
    for proposal in proposed.iter().flat_map(with_parts) {
        if laws.len() >= EVALUATED {
            break;
        }
        let law = law_of(&ground, &proposal, &format!("{id}_candidate_{}", laws.len() + 1))?;
        // The same equation from two starts of its shape is one law.
        if laws.iter().all(|other| other.definition.equation != law.definition.equation) {
            laws.push(law);
        }
    }
    if let Some(best) = proposed.first() {
        let values = values_of(&ground, best)?;
        laws.extend(curve_of(&ground, best, &format!("{id}_candidate_curve"), &values)?);
    }
    say(0.55, "fitting the best laws");
    let evaluated = evaluated(&bench, &laws, named)?;
    say(0.95, "writing the answer");
    let list = ranked(&laws, named, evaluated, model, id);
    let best = list.first().filter(|law| law.kind == "law");
    let equation = best.map(|b| b.equation.clone());
    let proposal =
        laws.iter().find(|law| Some(&law.definition.equation) == equation.as_ref()).map(|l| &l.proposal);
    let drawn = match proposal.or(proposed.first()) {
        Some(proposal) => drawn(&ground, proposal, best)?,
        None => None,
    };
    Ok(Discovery { laws: list, tried, drawn })
}

/// A proposal and every smaller one that is part of it: the regression is linear, and where each law fits best, one of its
/// terms may have nothing left to do.
fn with_parts(proposal: &search::Proposal) -> Vec<search::Proposal> {
    let count = proposal.terms.len();
    let of = |mask: usize| {
        let holds = |i: &usize| mask & (1 << i) != 0;
        search::Proposal {
            terms: (0..count).filter(holds).filter_map(|i| proposal.terms.get(i).cloned()).collect(),
            coefficients: (0..count)
                .filter(holds)
                .filter_map(|i| proposal.coefficients.get(i).copied())
                .collect(),
            score: proposal.score,
        }
    };
    (1..1_usize << count).rev().map(of).collect()
}

/// Whether a term of a law ended without a coefficient: then it is another, smaller law.
fn has_idle_term(law: &Law, evaluated: &FittedLaw) -> bool {
    let values = evaluated.values.first().map_or(&[][..], |(_, values)| values);
    law.proposal.terms.len() > 1
        && law
            .definition
            .parameters
            .iter()
            .zip(values)
            .any(|(p, value)| p.role == whorl_dynamics::effects::Role::Amplitude && *value == 0.0)
}

/// Registers the laws for as long as they are evaluated.
fn evaluated(
    bench: &Bench<'_>,
    laws: &[Law],
    named: &[Vec<String>],
) -> Result<Vec<Option<FittedLaw>>, DiscoveryError> {
    let mut sets: Vec<Vec<String>> = vec![Vec::new()];
    for law in laws {
        let registered = WrittenEffect::new(law.definition.clone()).map_err(DiscoveryError::from);
        let registered = registered.and_then(|effect| Ok(register(effect)?));
        if let Err(error) = registered {
            laws.iter().for_each(|law| withdraw(&law.definition.id));
            return Err(error);
        }
        sets.push(vec![law.definition.id.clone()]);
    }
    sets.extend(named.iter().cloned());
    let evaluated = bench.evaluate(&sets);
    laws.iter().for_each(|law| withdraw(&law.definition.id));
    Ok(evaluated?)
}

/// Everything with its probability, most probable first.
fn ranked(
    laws: &[Law],
    named: &[Vec<String>],
    evaluated: Vec<Option<FittedLaw>>,
    model: &PlatformModel,
    id: &str,
) -> Vec<EvaluatedLaw> {
    let nothing = evaluated.first().cloned().flatten();
    let reference = nothing.as_ref().map_or(0.0, |w| w.log_evidence);
    let held_out = nothing.as_ref().and_then(|w| w.held_log_likelihood);
    let mut list: Vec<(f64, EvaluatedLaw)> = Vec::new();
    for (i, evaluated) in evaluated.into_iter().enumerate() {
        let Some(evaluated) = evaluated else { continue };
        let law = i.checked_sub(1).and_then(|i| laws.get(i));
        if law.is_some_and(|law| has_idle_term(law, &evaluated)) {
            continue;
        }
        let set = i.checked_sub(1 + laws.len()).and_then(|i| named.get(i));
        let (log_prior, kind) = match (law, set) {
            (Some(law), _) => (UNMODELLED.ln() + law.log_prior, if law.is_curve { "curve" } else { "law" }),
            (None, Some(set)) => (set.len() as f64 * PRESENT.ln(), "effect"),
            (None, None) => (0.0, "nothing"),
        };
        let equation = match (law, set) {
            (Some(law), _) => law.definition.equation.clone(),
            (None, Some(set)) => {
                let each: Vec<&str> =
                    set.iter().filter_map(|id| find(id)).map(|effect| effect.info().equation).collect();
                each.join("; ")
            }
            (None, None) => String::new(),
        };
        let sentence = match (law, set) {
            (Some(law), _) => law.sentence.clone(),
            (None, Some(set)) => format!("The catalogue's {}.", set.join(" and ")),
            (None, None) => {
                "The model as it is, with a slow random torque where the data need one.".to_owned()
            }
        };
        let parameters = evaluated
            .values
            .iter()
            .flat_map(|(of, values)| {
                let specs = match law {
                    Some(law) => WrittenEffect::new(law.definition.clone())
                        .map(|effect| whorl_dynamics::Effect::parameters(&effect, model))
                        .unwrap_or_default(),
                    None => find(of).map(|effect| effect.parameters(model)).unwrap_or_default(),
                };
                specs.into_iter().zip(values.clone()).map(|(spec, value)| FittedValue {
                    name: spec.name,
                    unit: spec.unit.to_owned(),
                    value,
                })
            })
            .collect();
        let definition = law.map(|law| Definition { id: id.to_owned(), ..law.definition.clone() });
        list.push((
            evaluated.log_evidence + log_prior,
            EvaluatedLaw {
                sentence,
                equation,
                kind,
                probability: 0.0,
                log_evidence: evaluated.log_evidence - reference,
                held_out_gain: evaluated
                    .held_log_likelihood
                    .zip(held_out)
                    .map(|(with, without)| with - without),
                background_n_m: evaluated.background_n_m,
                parameters,
                variables: law.map_or_else(Vec::new, |law| {
                    law.proposal.terms.iter().flat_map(|t| t.variables.iter().cloned()).collect()
                }),
                definition,
            },
        ));
    }
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    let largest = list.first().map_or(0.0, |(score, _)| *score);
    let sum: f64 = list.iter().map(|(score, _)| (score - largest).exp()).sum();
    list.into_iter()
        .map(|(score, law)| EvaluatedLaw { probability: (score - largest).exp() / sum, ..law })
        .collect()
}

/// Values of the variable of a proposal's first term over all intervals.
fn values_of(ground: &Ground<'_>, proposal: &search::Proposal) -> Result<Vec<f64>, DiscoveryError> {
    let Some(text) = proposal.terms.first().and_then(|t| t.variables.first()) else { return Ok(Vec::new()) };
    if !ground.variables.iter().any(|v| v.text == *text) {
        return Ok(Vec::new());
    }
    let formula = Formula::new(text)?;
    let all = ground.bench.over_runs(&Vec::new(), |values: &mut Vec<f64>, environment, _| {
        values.push(formula.number(environment));
    })?;
    Ok(all.concat())
}

/// The torque in the direction of a law, measured in bins of its variable: a regression on hat functions.
fn drawn(
    ground: &Ground<'_>,
    proposal: &search::Proposal,
    best: Option<&EvaluatedLaw>,
) -> Result<Option<Drawn>, DiscoveryError> {
    let Some(term) = proposal.terms.first().filter(|t| t.variables.len() == 1 && !t.is_lag) else {
        return Ok(None);
    };
    let Some(variable) = ground.variables.iter().find(|v| term.variables.contains(&v.text)) else {
        return Ok(None);
    };
    let Some(direction) = term.direction_text(ground.largest_rate_rad_s) else { return Ok(None) };
    let mut values = values_of(ground, proposal)?;
    values.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else { return Ok(None) };
    if high <= low {
        return Ok(None);
    }
    let step = (high - low) / (DRAWN - 1) as f64;
    let (of, along) = (Formula::new(&variable.text)?, Formula::new(&direction)?);
    let pushing = || -> bench::Pushing<'_> {
        Box::new(|environment, _, pushes| {
            let (at, along) = (of.number(environment), along.vector_b(environment).unwrap_or_default());
            let hat = |i: usize| (1.0 - ((at - low) / step - i as f64).abs()).max(0.0);
            pushes.extend((0..DRAWN).map(|i| Push::Body(Vector3::from(along) * hat(i))));
        })
    };
    let regression = ground.bench.regression(DRAWN, DRAWN, pushing)?;
    let all: Vec<usize> = (0..DRAWN).collect();
    let Some(fit) = regression.fit(&all, 3.0 * ground.bench.applied_n_m) else {
        return Ok(None);
    };
    let law = law_over(term, variable, best);
    let points = (0..DRAWN)
        .map(|i| {
            let at = low + step * i as f64;
            DrawnPoint {
                at,
                torque_n_m: fit.coefficients.get(i).copied().unwrap_or(0.0),
                stddev_n_m: fit.stddevs.get(i).copied().unwrap_or(0.0),
                law_n_m: law.as_ref().map(|law| law(at)),
            }
        })
        .collect();
    Ok(Some(Drawn {
        variable: format!("{} [{}]", variable.words, variable.unit),
        direction: term.direction_words(),
        points,
    }))
}

/// The law's factor as a function of its variable, where it is one term.
fn law_over<'l>(
    term: &'l terms::Term,
    variable: &'l Variable,
    best: Option<&'l EvaluatedLaw>,
) -> Option<impl Fn(f64) -> f64 + 'l> {
    let law = best.filter(|law| law.parameters.iter().filter(|p| p.name.starts_with('k')).count() == 1)?;
    let k = law.parameters.iter().find(|p| p.name == "k")?.value;
    let sign = if law.equation.starts_with('-') { -1.0 } else { 1.0 };
    let shape = term.shape.as_ref().and_then(|s| law.parameters.iter().find(|p| p.name == s.name));
    let text = match shape {
        Some(shape) => term.factor_with(&format!("{} [{}]", shape.value, shape.unit)),
        None => term.factor.clone(),
    };
    Some(move |at: f64| {
        // The variable as a number with its unit, in parentheses: it may be negative.
        let number = format!("({at} [{}])", variable.unit);
        let model = PlatformModel::whorl_1_reference();
        let rest = whorl_dynamics::Environment::new(
            &model,
            nalgebra::UnitQuaternion::identity(),
            nalgebra::Vector3::zeros(),
        );
        Formula::new(&text.replace(&variable.text, &number)).map_or(f64::NAN, |f| sign * k * f.number(&rest))
    })
}
