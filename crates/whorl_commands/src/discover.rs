//! Before and after a search for a law: whether to search, what competes, and the answer.

use whorl_identification::{Diagnosis, Verdict};
use whorl_identification::{Discovery, EvaluatedLaw};
use whorl_math::three_digits;

/// Version of the JSON output.
const SCHEMA: u32 = 2;

/// Probability from which the best law is called the law.
const SURE: f64 = 0.9;

/// Sets of effects of the catalogue that compete with laws.
const COMPETITORS: usize = 3;

/// Why there is nothing to search for, if so.
#[must_use]
pub fn settled(diagnosis: &Diagnosis) -> Option<String> {
    match diagnosis.verdict {
        Verdict::Named | Verdict::Confounded => {
            Some("The catalogue explains the data: no other law is searched for.".to_owned())
        }
        Verdict::NothingMissing => Some("Nothing is missing: no law is searched for.".to_owned()),
        Verdict::NotEnoughInformation | Verdict::Unknown => None,
    }
}

/// The sets of effects of the catalogue that compete with laws: the most probable of a diagnosis.
#[must_use]
pub fn competitors(diagnosis: &Diagnosis) -> Vec<Vec<String>> {
    diagnosis
        .explanations
        .iter()
        .filter(|e| !e.effects.is_empty() && !e.with_unknown)
        .map(|e| e.effects.clone())
        .chain(diagnosis.candidates.iter().map(|c| vec![c.effect.clone()]))
        .fold(Vec::new(), |mut list, set| {
            if !list.contains(&set) && list.len() < COMPETITORS {
                list.push(set);
            }
            list
        })
}

/// The answer in sentences.
#[must_use]
pub fn answer(found: &Discovery) -> Vec<String> {
    let mut sentences = Vec::new();
    let Some(best) = found.laws.first() else { return vec!["Nothing could be evaluated.".to_owned()] };
    let percent = |law: &EvaluatedLaw| format!("{:.0} %", 100.0 * law.probability);
    let held = |law: &EvaluatedLaw| match law.held_out_gain {
        Some(gain) => format!(", held-out log likelihood {gain:+.1}"),
        None => String::new(),
    };
    match best.kind {
        "nothing" => sentences.push(format!(
            "No law is more probable than none ({}): what is missing is no simple function of what was recorded.",
            percent(best)
        )),
        "effect" => sentences.push(format!("{} It is likelier than any law that was found ({}).", best.sentence, percent(best))),
        _ if best.probability >= SURE => sentences.push(format!(
            "{} It has {}, of {} laws tried{}. Equation: torque = {}.",
            best.sentence,
            percent(best),
            found.tried,
            held(best),
            best.equation
        )),
        _ => {
            let others: Vec<_> = found.laws.iter().skip(1).filter(|law| law.probability > 0.05).collect();
            let is_alone = others.iter().all(|law| law.equation.is_empty());
            let many = if is_alone { "One law explains the data, and is likely, not sure" } else { "Several laws explain the data about as well. The likeliest" };
            sentences.push(format!(
                "{many} ({}{}): {} Equation: torque = {}.",
                percent(best),
                held(best),
                best.sentence,
                best.equation
            ));
            // What has no equation is that there is no law.
            let named = |equation: &str| if equation.is_empty() { "no law, but a slow random torque" } else { equation }.to_owned();
            let others: Vec<String> =
                others.iter().map(|law| format!("{} ({})", named(&law.equation), percent(law))).collect();
            if !others.is_empty() {
                let run = if is_alone { "A longer run" } else { "A run with other rates or attitudes" };
                sentences.push(format!("Also possible: {}. {run} would tell.", others.join("; ")));
            }
        }
    }
    if let Some(best) = found.best().filter(|law| !law.parameters.is_empty() && law.kind == "law") {
        let values: Vec<String> = best
            .parameters
            .iter()
            .map(|p| {
                format!("{} = {} +- {} {}", p.name, three_digits(p.value), three_digits(p.stddev), p.unit)
            })
            .collect();
        sentences.push(format!("Fitted: {}.", values.join(", ")));
    }
    sentences
}

/// The catalogue's verdict, the answer, and what was found, if anything was searched for.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_json(
    platform: &str,
    diagnosis: &Diagnosis,
    found: Option<&Discovery>,
    answer: &[String],
) -> anyhow::Result<serde_json::Value> {
    Ok(serde_json::json!({
        "schema": SCHEMA,
        "platform": platform,
        "catalogue": { "verdict": diagnosis.verdict, "effects": diagnosis.effects, "unknown": diagnosis.unknown },
        "answer": answer,
        "discovery": found.map(serde_json::to_value).transpose()?,
    }))
}
