//! Comparison of before and after in words.

use whorl_dynamics::effects::find;
use whorl_identification::Tie;
use whorl_math::three_digits;
use whorl_validation::comparison::ahead;

use super::versions::worst_gyro;
use super::{Adoption, BASE, WORSE};

impl Adoption {
    /// Improvement by each set of effects, in words.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let versions = &self.versions;
        let mut answer = Vec::new();
        let Some(before) = versions.first() else { return answer };
        for version in versions.iter().filter(|v| !v.effects.is_empty()) {
            let mut text = format!("{}:", capitalised(&version.name));
            for (held_out, kind) in [(false, "training"), (true, "held-out")] {
                if let (Some(a), Some(b)) =
                    (before.prediction_error(held_out), version.prediction_error(held_out))
                {
                    text.push_str(&format!(
                        " prediction error on {kind} runs {a:.2} -> {b:.2} times the noise;"
                    ));
                }
            }
            let held_out = version.runs.iter().any(|r| r.held_out);
            if let Some((name, horizon_s, errors)) = worst_gyro(versions, held_out) {
                let place = versions.iter().position(|v| std::ptr::eq(v, version)).unwrap_or(0);
                if let (Some([a, _]), Some([b, predicted])) = (errors.first(), errors.get(place)) {
                    text.push_str(&format!(
                        " {} {name} over {} s {} -> {} deg/s RMS (predicted deviation {}).",
                        if held_out { "held-out" } else { "training" },
                        ahead(horizon_s),
                        three_digits(*a),
                        three_digits(*b),
                        three_digits(*predicted)
                    ));
                }
            }
            if text.ends_with(';') {
                text.pop();
                text.push('.');
            }
            answer.push(text);
            answer.extend(version.fit.iter().flat_map(|fit| &fit.ties).map(said_of));
            let base = versions.iter().find(|v| v.name == BASE);
            if let Some((a, b)) = base.and_then(|base| {
                Some((base.prediction_error(held_out)?, version.prediction_error(held_out)?))
            }) && b > a / WORSE
            {
                answer.push(format!(
                "Refitting inertia, centre of mass and actuators alone does as well ({a:.3} against {b:.3}): these data do not support {}.",
                version.effects.join(" and ")
            ));
            }
        }
        if !before.runs.iter().any(|r| r.held_out) {
            answer.push(
                "No held-out run was given: whether the model predicts other runs better was not tested."
                    .to_owned(),
            );
        }
        answer
    }
}

/// What is known of two parameters that are not told apart, and what would tell them apart.
fn said_of(tie: &Tie) -> String {
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

fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |c| c.to_uppercase().chain(characters).collect())
}
