//! Which laws explain the data best, by the regression of the unlisted laws of a diagnosis, and each as an effect: its equation, parameters with units
//! and priors, and a sentence about it.

use whorl_dynamics::effects::Role;
use whorl_dynamics::effects::written::{
    ActsOn, Definition, DefinitionError, Dimension, Formula, WrittenParameter,
};
use whorl_prediction::PredictionError;
use whorl_validation::quantities;

use super::{Candidate, DiscoveryError, EvaluatedLaw, UNMODELLED};
use crate::DiagnosisError;
use crate::grammar::{Grammar, Law, SHARE, Term, Way, Written, seen, two_digits, written};
use crate::selection::Selection;
use crate::selection::unlisted::scored;
use crate::signals::observed::Applied;

/// Laws that are evaluated where each fits best.
const EVALUATED: usize = 5;
/// Friction that drives is possible (a turbine), and rare: one in so many.
const DRIVES: f64 = 20.0;
/// Rate below which directions along the rate fade out, as a share of the largest.
const FADE: f64 = 0.01;
/// Largest plausible coefficient, over the one that was found.
const LARGEST: f64 = 100.0;
/// Range of a shape about where it was found, as a factor.
const SHAPE_RANGE: f64 = 20.0;

/// The laws that explain most, best first, as effects under ids that begin with this one, and how many were tried.
pub(super) fn laws(selection: &Selection<'_>, id: &str) -> Result<(Vec<Candidate>, usize), DiscoveryError> {
    let (runs, base, observed) = (&selection.runs, selection.base(), &selection.observed);
    let model = base.refit(runs.reference).model_at(&base.fitted.at);
    let model = model.ok_or(DiagnosisError::Prediction(PredictionError::NoModel))?;
    let applied = Applied::of(observed, &model, runs.reference.settings.at_work_s);
    let quantities = quantities(&model, runs.training.iter().chain(runs.held_out));
    let of_values = |values: &Vec<f64>| values.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let largest: Vec<f64> = seen(&quantities, observed, &model).iter().map(of_values).collect();
    let rate = quantities.iter().zip(&largest).find(|(quantity, _)| quantity.name == "rate");
    let fade_rad_s = two_digits(FADE * rate.map_or(0.0, |(_, largest)| *largest)).max(1e-9);
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let groups = written(&quantities, &largest, &wheels);
    let mut grammar = Grammar::new(quantities, groups, false);
    // About one axis each.
    let groups = &grammar.groups;
    grammar.laws.retain(|law| law.axis.is_some() || groups[law.group][0].way != Way::BodyOrRoom);
    let found = scored((runs, base, observed.as_slice()), &model, &grammar, &applied)?;
    // In SI units; on wheels of that on which it is largest.
    let coefficient = |law: &Law, values: &[f64]| {
        let in_si = |(term, value): (&Term, &f64)| {
            let size_n_m = match term.way {
                Way::Wheel(wheel) => applied.wheel_n_m(wheel),
                _ => applied.body_n_m(),
            };
            Some(value * SHARE * size_n_m / term.written.as_ref()?.unit())
        };
        let all = grammar.groups[law.group].iter().zip(values).filter_map(in_si);
        all.max_by(|a, b| a.abs().total_cmp(&b.abs()))
    };
    let mut all: Vec<(f64, &Written, &Law, f64)> = Vec::new();
    for (law, found) in grammar.laws.iter().zip(found) {
        let Some((found, written)) = found.zip(grammar.term(law).written.as_ref()) else { continue };
        let Some(coefficient) = coefficient(law, &found.values) else { continue };
        let drives = coefficient > 0.0 && written.can_only_brake(grammar.term(law).way, law);
        let rare = if drives { DRIVES.ln() } else { 0.0 };
        all.push((found.gain + written.log_prior - rare, written, law, coefficient));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut candidates = Vec::new();
    for (k, (_, written, law, coefficient)) in all.into_iter().take(EVALUATED).enumerate() {
        let id = format!("{id}_candidate_{}", k + 1);
        let definition = definition_of(written, (grammar.term(law).way, law), coefficient, fade_rad_s, id)?;
        candidates.push(Candidate {
            effects: vec![definition.id.clone()],
            log_prior: UNMODELLED.ln() + written.log_prior,
            law: EvaluatedLaw {
                sentence: definition.explanation.clone(),
                equation: definition.equation.clone(),
                kind: "law",
                variables: written.variables(),
                definition: Some(definition),
                ..EvaluatedLaw::default()
            },
        });
    }
    Ok((candidates, grammar.laws.len()))
}

/// The direction of a law as a unit vector in an equation (`None` on wheels), and in words.
fn direction(way: Way, law: &Law, fade_rad_s: f64) -> (Option<String>, String) {
    let axis = law.axis.unwrap_or(2);
    let (unit, letter) = (["(1, 0, 0)", "(0, 1, 0)", "(0, 0, 1)"][axis], ["x", "y", "z"][axis]);
    let (text, words) = match (way, law.world, axis) {
        (Way::AlongRate, ..) => (format!("unit(rate, {fade_rad_s} [rad/s])"), "along the rate".to_owned()),
        (Way::Wheel(_), ..) => return (None, "on each wheel".to_owned()),
        (_, true, 2) => ("vertical".to_owned(), "about the vertical".to_owned()),
        (_, true, _) => (format!("body({unit})"), format!("about world {letter}")),
        (_, false, _) => (unit.to_owned(), format!("about body {letter}")),
    };
    (Some(text), words)
}

/// Unit of a torque over what an equation gives.
fn torque_per(equation: &str) -> Result<String, DefinitionError> {
    let per = (Dimension::NONE / Formula::new(equation)?.dimension()).unit();
    Ok(match per.strip_prefix('1') {
        Some("") => "N m".to_owned(),
        Some(below) if below.starts_with('/') => format!("N m{below}"),
        _ => format!("N m {per}"),
    })
}

/// Makes an effect of a law, under this id.
fn definition_of(
    written: &Written,
    (way, law): (Way, &Law),
    coefficient: f64,
    fade_rad_s: f64,
    id: String,
) -> Result<Definition, DefinitionError> {
    let size = two_digits(coefficient.abs());
    let words = match way {
        Way::AlongRate if written.variables().is_empty() => {
            "nothing but its direction (dry friction)".to_owned()
        }
        _ => written.words(),
    };
    // What may only brake is written with its sign, so that its coefficient is never negative.
    let brakes = coefficient < 0.0 && written.can_only_brake(way, law);
    let on_wheels = matches!(way, Way::Wheel(_));
    // On wheels the factor is of the wheel's own speed.
    let own_speed = if on_wheels { "wheel_speed[1]" } else { "speed" };
    let in_numbers = written.equation(None).replace("speed", own_speed);
    let mut parameters = vec![WrittenParameter {
        name: "k".to_owned(),
        unit: torque_per(&in_numbers)?,
        range: if brakes { (0.0, LARGEST * size) } else { (-LARGEST * size, LARGEST * size) },
        neutral: 0.0,
        prior: size,
        role: Role::Amplitude,
        known: false,
        starts: Vec::new(),
        meaning: format!("Coefficient: how it goes with {words}."),
    }];
    parameters.extend(written.parameter().map(|(name, value, unit, meaning)| WrittenParameter {
        name: name.to_owned(),
        unit: unit.to_owned(),
        range: (two_digits(value / SHAPE_RANGE), two_digits(value * SHAPE_RANGE)),
        neutral: value,
        prior: 0.5 * value,
        role: Role::Shape,
        known: false,
        starts: vec![two_digits(0.4 * value), value, two_digits(2.5 * value)],
        meaning: meaning.to_owned(),
    }));
    let factor = written.equation(written.parameter().map(|(name, ..)| name));
    let (direction, in_words) = direction(way, law, fade_rad_s);
    let parts = [Some("k".to_owned()), Some(factor).filter(|factor| factor != "1"), direction];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    let does = match way {
        Way::Wheel(_) | Way::AlongRate if coefficient < 0.0 => "brakes",
        Way::Wheel(_) | Way::AlongRate => "drives",
        _ => "acts",
    };
    Ok(Definition {
        id,
        title: format!("torque that goes with {words}, {in_words}"),
        explanation: format!("A torque that {does} {in_words} with {words}."),
        acts_on: if on_wheels { ActsOn::WheelTorque } else { ActsOn::Torque },
        equation: format!("{}{}", if brakes { "-" } else { "" }, parts.join(" * ")),
        parameters,
        is_passive: brakes,
        source: "found in recordings by `whorl discover`; not derived from physics".to_owned(),
        ..Definition::default()
    })
}
