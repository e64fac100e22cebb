//! A proposal as an effect: its equation, parameters with units and priors, and sentences about it.

use whorl_dynamics::effects::Role;
use whorl_dynamics::effects::written::{
    ActsOn, CurveShape, Definition, Dimension, Formula, WrittenCurve, WrittenParameter, WrittenState,
};

use super::DiscoveryError;
use super::search::{Ground, Proposal};
use crate::grammar::terms::{Direction, Term, two_digits};

/// Largest plausible coefficient, over the one that was found.
const LARGEST: f64 = 100.0;

/// Range of a shape about where it was found, as a factor.
const SHAPE_RANGE: f64 = 20.0;

/// Knots of a measured curve.
const KNOTS: usize = 5;

/// A law as an effect.
#[derive(Debug, Clone)]
pub(super) struct Law {
    pub definition: Definition,
    /// What it is, in a sentence.
    pub sentence: String,
    /// Log of its prior probability beside that of anything unmodelled.
    pub log_prior: f64,
    pub is_curve: bool,
    pub proposal: Proposal,
}

fn factor_dimension(term: &Term) -> Result<Dimension, DiscoveryError> {
    let text = term.factor_in_numbers();
    // On wheels the factor is of the wheel's own speed.
    let text =
        if term.direction == Direction::Wheels { text.replace("speed", "wheel_speed[1]") } else { text };
    Ok(Formula::new(&text)?.dimension())
}

/// Unit of a torque over this.
fn torque_per(dimension: Dimension) -> String {
    let per = (Dimension::NONE / dimension).unit();
    match per.strip_prefix('1') {
        Some("") => "N m".to_owned(),
        Some(below) if below.starts_with('/') => format!("N m{below}"),
        _ => format!("N m {per}"),
    }
}

/// Makes an effect of a proposal, under this id.
pub(super) fn law_of(ground: &Ground<'_>, proposal: &Proposal, id: &str) -> Result<Law, DiscoveryError> {
    let several = proposal.terms.len() > 1;
    let mut parameters = Vec::new();
    let mut states = Vec::new();
    let mut sum = String::new();
    let mut is_passive = true;
    for (i, (term, coefficient)) in proposal.terms.iter().zip(&proposal.coefficients).enumerate() {
        let name = |of: &str| if several { format!("{of}{}", i + 1) } else { of.to_owned() };
        let unit = torque_per(factor_dimension(term)?);
        // What may only brake is written with its sign, so that its coefficient is never negative.
        let brakes = term.can_be_passive(&ground.variables) && *coefficient < 0.0;
        is_passive &= brakes;
        let size = two_digits(coefficient.abs());
        parameters.push(WrittenParameter {
            name: name("k"),
            unit,
            range: if brakes { (0.0, LARGEST * size) } else { (-LARGEST * size, LARGEST * size) },
            neutral: 0.0,
            prior: size,
            role: Role::Amplitude,
            known: false,
            starts: Vec::new(),
            meaning: format!("Coefficient: how it goes with {}.", term.words),
        });
        let mut factor = match &term.shape {
            Some(shape) if !term.is_lag => term.factor_with(&name(shape.name)),
            _ => term.factor.clone(),
        };
        if let Some(shape) = &term.shape {
            parameters.push(WrittenParameter {
                name: name(shape.name),
                unit: shape.unit.clone(),
                range: (two_digits(shape.value / SHAPE_RANGE), two_digits(shape.value * SHAPE_RANGE)),
                neutral: shape.value,
                prior: 0.5 * shape.value,
                role: Role::Shape,
                known: false,
                starts: vec![two_digits(0.4 * shape.value), shape.value, two_digits(2.5 * shape.value)],
                meaning: shape.meaning.to_owned(),
            });
            if term.is_lag {
                let late = name("late");
                states.push(WrittenState {
                    name: late.clone(),
                    unit: factor_dimension(term)?.unit(),
                    derivative: format!("({} - {late}) / {}", term.factor, name(shape.name)),
                });
                factor = late;
            }
        }
        let direction = term.direction_text(ground.largest_rate_rad_s);
        let mut parts = vec![name("k")];
        parts.extend((factor != "1").then_some(factor));
        parts.extend(direction);
        let sign = match (brakes, sum.is_empty()) {
            (true, true) => "-",
            (true, false) => " - ",
            (false, true) => "",
            (false, false) => " + ",
        };
        sum += &format!("{sign}{}", parts.join(" * "));
    }
    let on_wheels = proposal.terms.iter().any(|t| t.direction == Direction::Wheels);
    let sentence = sentence(proposal);
    let definition = Definition {
        id: id.to_owned(),
        title: title(proposal),
        explanation: sentence.clone(),
        acts_on: if on_wheels { ActsOn::WheelTorque } else { ActsOn::Torque },
        equation: sum,
        parameters,
        is_passive: is_passive && states.is_empty(),
        states,
        source: "found in recordings by `whorl discover`; not derived from physics".to_owned(),
        ..Definition::default()
    };
    let log_prior = proposal.terms.iter().map(|t| t.log_prior).sum::<f64>()
        + (1..=proposal.terms.len()).map(|k| (k as f64).ln()).sum::<f64>();
    Ok(Law { definition, sentence, log_prior, is_curve: false, proposal: proposal.clone() })
}

fn title(proposal: &Proposal) -> String {
    let each: Vec<String> =
        proposal.terms.iter().map(|t| format!("{}, {}", t.words, t.direction_words())).collect();
    format!("torque that goes with {}", each.join("; and "))
}

fn sentence(proposal: &Proposal) -> String {
    let each: Vec<String> = proposal
        .terms
        .iter()
        .zip(&proposal.coefficients)
        .map(|(t, c)| {
            let does = if t.direction == Direction::AlongRate || t.direction == Direction::Wheels {
                if *c < 0.0 { "brakes" } else { "drives" }
            } else {
                "acts"
            };
            format!("{does} {} with {}", t.direction_words(), t.words)
        })
        .collect();
    format!("A torque that {}.", each.join(", and one that "))
}

/// The torque as a measured curve over the variable of a proposal's first term, about the same axis. `None` where that is
/// no function of one variable.
pub(super) fn curve_of(
    ground: &Ground<'_>,
    proposal: &Proposal,
    id: &str,
    values: &[f64],
) -> Result<Option<Law>, DiscoveryError> {
    let Some(term) = proposal.terms.first().filter(|t| t.variables.len() == 1 && !t.is_lag) else {
        return Ok(None);
    };
    let Some(variable) = ground.variables.iter().find(|v| term.variables.contains(&v.text)) else {
        return Ok(None);
    };
    let Some(direction) = term.direction_text(ground.largest_rate_rad_s) else { return Ok(None) };
    let knots = knots(values, term.direction == Direction::AlongRate);
    if knots.len() < 2 {
        return Ok(None);
    }
    let brakes = term.direction == Direction::AlongRate;
    let size_n_m = two_digits(ground.bench.applied_n_m);
    let curve = WrittenCurve {
        name: "torque".to_owned(),
        of: variable.text.clone(),
        of_unit: variable.unit.to_owned(),
        knots,
        unit: "N m".to_owned(),
        largest: 10.0 * size_n_m,
        prior: 0.1 * size_n_m,
        shape: if brakes { CurveShape::Positive } else { CurveShape::Free },
    };
    let sentence = format!(
        "A torque {} that is a measured curve over {}: measured, not understood.",
        term.direction_words(),
        variable.words
    );
    let definition = Definition {
        id: id.to_owned(),
        title: format!("measured torque over {}", variable.words),
        explanation: sentence.clone(),
        equation: format!("{}torque * {direction}", if brakes { "-" } else { "" }),
        curves: vec![curve],
        is_passive: brakes,
        source: "measured by `whorl discover`; not understood".to_owned(),
        ..Definition::default()
    };
    // A variable and a direction: which curve it is, its coefficients' priors pay.
    let log_prior = -((ground.variables.len() + 2) as f64).ln() - 8f64.ln();
    Ok(Some(Law { definition, sentence, log_prior, is_curve: true, proposal: proposal.clone() }))
}

/// Knots where the data are: from the smallest to the largest value, between them at equal shares of the samples.
fn knots(values: &[f64], from_zero: bool) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let i = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
        sorted.get(i).copied().unwrap_or(0.0)
    };
    let mut knots: Vec<f64> = (0..KNOTS).map(|i| two_digits(at(i as f64 / (KNOTS - 1) as f64))).collect();
    if from_zero && let Some(first) = knots.first_mut() {
        *first = 0.0;
    }
    let whole = at(1.0) - at(0.0);
    knots.dedup_by(|later, earlier| *later - *earlier < 0.02 * whole);
    knots
}
