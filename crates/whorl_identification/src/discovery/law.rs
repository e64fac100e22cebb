//! Which laws explain the data best, and each as an effect: its equation, parameters with units and priors, and a sentence about it.

use whorl_dynamics::effects::Role;
use whorl_dynamics::effects::written::{ActsOn, Definition, Dimension, Formula, WrittenParameter};
use whorl_validation::quantities;

use super::{Candidate, EvaluatedLaw};
use crate::Outcome;
use crate::grammar::{Grammar, Law, SHARE, Way, Written, ranges, two_digits, written};
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
pub(super) fn laws(selection: &Selection<'_>, id: &str) -> Outcome<(Vec<Candidate>, usize)> {
    let (runs, base, observed) = (&selection.runs, selection.base(), &selection.observed);
    let model = base.model(runs.reference)?;
    let applied = Applied::of(observed, &model, runs.reference.settings.at_work_s);
    let quantities = quantities(&model, runs.training.iter().chain(runs.held_out));
    let ranges = ranges(&quantities, observed, &model);
    let largest: Vec<f64> = ranges.iter().map(|(low, high)| high.max(-low)).collect();
    let rate = quantities.iter().zip(&largest).find(|(quantity, _)| quantity.name == "rate");
    let fade_rad_s = two_digits(FADE * rate.map_or(0.0, |(_, largest)| *largest)).max(1e-9);
    let wheels: Vec<&str> = model.wheels().iter().map(|wheel| wheel.name.as_str()).collect();
    let groups = written(&quantities, &largest, &wheels);
    let mut grammar = Grammar::new(quantities, groups, false);
    // About one axis each.
    let groups = &grammar.groups;
    grammar.laws.retain(|law| law.axis.is_some() || groups[law.group][0].way != Way::BodyOrRoom);
    let found = scored((runs, base, observed), &grammar, &applied)?;
    let mut all: Vec<(f64, &Written, Way, &Law, f64)> = Vec::new();
    for (law, found) in grammar.laws.iter().zip(found) {
        let (Some(found), Some(written)) = (found, &grammar.term(law).written) else { continue };
        // In SI units; on wheels of that on which it is largest.
        let in_si = grammar.groups[law.group].iter().zip(&found.values).map(|(term, value)| match term.way {
            Way::Wheel(wheel) => value * applied.wheel_n_m(wheel),
            _ => value * applied.body_n_m(),
        });
        let Some(size) = in_si.max_by(|a, b| a.abs().total_cmp(&b.abs())) else { continue };
        let (coefficient, way) = (size * SHARE / written.unit(), grammar.term(law).way);
        let drives = coefficient > 0.0 && written.can_only_brake(way, law);
        let rare = if drives { DRIVES.ln() } else { 0.0 };
        all.push((found.gain + written.log_prior - rare, written, way, law, coefficient));
    }
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut candidates = Vec::new();
    for (k, (_, written, way, law, coefficient)) in all.into_iter().take(EVALUATED).enumerate() {
        let id = format!("{id}_candidate_{}", k + 1);
        let definition = definition_of(written, (way, law), coefficient, fade_rad_s, id)?;
        candidates.push(Candidate {
            effects: vec![definition.id.clone()],
            log_prior: runs.reference.settings.unmodelled.ln() + written.log_prior,
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
    match (way, law.world, axis) {
        (Way::Wheel(_), ..) => (None, "on each wheel".to_owned()),
        (Way::AlongRate, ..) => {
            (Some(format!("unit(rate, {fade_rad_s} [rad/s])")), "along the rate".to_owned())
        }
        (_, true, 2) => (Some("vertical".to_owned()), "about the vertical".to_owned()),
        (_, true, _) => (Some(format!("body({unit})")), format!("about world {letter}")),
        _ => (Some(unit.to_owned()), format!("about body {letter}")),
    }
}

/// Unit of a torque over what an equation gives.
fn torque_per(equation: &str) -> Outcome<String> {
    let per = (Dimension::NONE / Formula::new(equation)?.dimension()).unit();
    Ok(match per.strip_prefix('1') {
        Some("") => "N m".to_owned(),
        Some(below) if below.starts_with('/') => format!("N m{below}"),
        _ => format!("N m {per}"),
    })
}

fn definition_of(
    written: &Written,
    (way, law): (Way, &Law),
    coefficient: f64,
    fade_rad_s: f64,
    id: String,
) -> Outcome<Definition> {
    let size = two_digits(coefficient.abs());
    let on_wheels = matches!(way, Way::Wheel(_));
    let is_along = way == Way::AlongRate;
    let none = if is_along { "nothing but its direction (dry friction)" } else { "nothing: it is constant" };
    let words = Some(written.words()).filter(|of| !of.is_empty()).unwrap_or_else(|| none.to_owned());
    // What may only brake is written with its sign, so that its coefficient is never negative.
    let brakes = coefficient < 0.0 && written.can_only_brake(way, law);
    let parameter = |name: &str, unit, range, neutral, prior, starts, meaning| {
        let (name, role) = (name.to_owned(), if name == "k" { Role::Amplitude } else { Role::Shape });
        WrittenParameter { name, unit, range, neutral, prior, role, known: false, starts, meaning }
    };
    // The unit of the coefficient is that of a torque over what the equation gives; on wheels the factor is of the wheel's own speed.
    let shape = written.parameter();
    let number = shape.map_or_else(String::new, |(_, value, unit, _)| format!("{value} [{unit}]"));
    let own_speed = if on_wheels { "wheel_speed[1]" } else { "speed" };
    let factor = Some(written.equation(&number).replace("speed", own_speed)).filter(|of| !of.is_empty());
    let unit = torque_per(factor.as_deref().unwrap_or("1"))?;
    let range = (if brakes { 0.0 } else { -LARGEST * size }, LARGEST * size);
    let meaning = format!("Coefficient: how it goes with {words}.");
    let mut parameters = vec![parameter("k", unit, range, 0.0, size, Vec::new(), meaning)];
    parameters.extend(shape.map(|(name, value, unit, meaning)| {
        let range = (two_digits(value / SHAPE_RANGE), two_digits(value * SHAPE_RANGE));
        let starts = vec![two_digits(0.4 * value), value, two_digits(2.5 * value)];
        parameter(name, unit.to_owned(), range, value, 0.5 * value, starts, meaning.to_owned())
    }));
    let (direction, in_words) = direction(way, law, fade_rad_s);
    let factor = Some(written.equation(shape.map_or("", |(name, ..)| name))).filter(|of| !of.is_empty());
    let parts: Vec<String> = [Some("k".to_owned()), factor, direction].into_iter().flatten().collect();
    let along = if coefficient < 0.0 { "brakes" } else { "drives" };
    let does = if on_wheels || is_along { along } else { "acts" };
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
