//! Comparison of before and after in words.

use whorl_math::three_digits;

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
            if let Some((name, errors, floor)) = worst_gyro(versions, held_out) {
                let place = versions.iter().position(|v| std::ptr::eq(v, version)).unwrap_or(0);
                if let (Some(a), Some(b)) = (errors.first(), errors.get(place)) {
                    text.push_str(&format!(
                        " {} {name} over 10 s {} -> {} deg/s RMS (noise {}).",
                        if held_out { "held-out" } else { "training" },
                        three_digits(*a),
                        three_digits(*b),
                        three_digits(floor)
                    ));
                }
            }
            if text.ends_with(';') {
                text.pop();
                text.push('.');
            }
            answer.push(text);
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

fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |c| c.to_uppercase().chain(characters).collect())
}
