//! The answer in words.

use whorl_dynamics::effects::find;
use whorl_math::three_digits;

use crate::verdict::diagnosis::Candidate;
use crate::{Diagnosis, Explanation, Unknown, Verdict};

/// So many sets that explain the data as well are read out; all of them are in `confounded_with`.
const MOST_SETS: usize = 5;

fn title(id: &str) -> String {
    find(id).map_or_else(|| id.to_owned(), |e| format!("{} ({id})", e.info().title))
}

fn list(set: &[String]) -> String {
    if set.is_empty() {
        return "nothing".to_owned();
    }
    set.iter().map(|id| title(id)).collect::<Vec<_>>().join(" and ")
}

/// A unit behind its number; nothing behind a plain number.
fn behind(unit: &str) -> String {
    if unit == "1" { String::new() } else { format!(" {unit}") }
}

fn sizes(candidate: &Candidate) -> String {
    let mut parts: Vec<String> = candidate
        .parameters
        .iter()
        .take(4)
        .map(|p| format!("{} = {:.3e} +- {:.1e}{}", p.name, p.estimate, p.stddev, behind(&p.unit)))
        .collect();
    if candidate.parameters.len() > 4 {
        parts.push("...".to_owned());
    }
    parts.join(", ")
}

/// A probability in words.
fn percent(probability: f64) -> String {
    match 100.0 * probability {
        p if p >= 99.5 => "over 99 %".to_owned(),
        p if p < 1.0 => "below 1 %".to_owned(),
        p => format!("{p:.0} %"),
    }
}

impl Explanation {
    fn title(&self) -> String {
        match (self.effects.is_empty(), self.with_unknown) {
            (true, false) => "nothing is missing".to_owned(),
            (true, true) => "something unmodelled".to_owned(),
            (false, false) => list(&self.effects),
            (false, true) => format!("{} and something unmodelled", list(&self.effects)),
        }
    }
}

impl Unknown {
    /// On what it depends, and how large it is.
    fn sentences(&self) -> Vec<String> {
        // Of what only the error of predictions shows, nothing else is known.
        if self.share == 0.0 && self.size == 0.0 {
            return Vec::new();
        }
        let line = self.frequency_hz.map_or_else(String::new, |f| format!(", a line at {f:.3} Hz"));
        let parity =
            if self.parity == "none" { String::new() } else { format!(", {} symmetry", self.parity) };
        // Beside a random torque that is there anyway it may be little of all that the model lacks.
        let percent = (100.0 * self.share).round();
        let explains =
            if percent >= 1.0 { format!("; this explains {percent} % of the excess") } else { String::new() };
        let mut sentences = vec![format!(
            "The residual correlates best with {}{parity}{line}, about {} of the {} frame{explains}.",
            self.variable, self.axis, self.frame
        )];
        if self.size > 0.0 {
            sentences.push(format!(
                "Its size is {:.1e}{} (root mean square).",
                self.size,
                behind(&self.unit)
            ));
        }
        sentences
    }
}

impl Diagnosis {
    /// How probable a set is, to be read after its name; empty where it was not evaluated.
    fn per_cent(&self, set: &[String]) -> String {
        let with_unknown = self.unknown.is_some();
        let own = self.explanations.iter().find(|e| e.with_unknown == with_unknown && e.effects == set);
        own.map_or_else(String::new, |e| format!(", {}", percent(e.probability)))
    }

    /// The verdict in a few sentences, most important first.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let mut text = Vec::new();
        let row = |id: &String| self.candidates.iter().find(|c| c.effect == *id);
        match self.verdict {
            Verdict::Named => {
                text.push(format!(
                    "The model lacks: {}{}.",
                    list(&self.effects),
                    self.per_cent(&self.effects)
                ));
            }
            Verdict::Confounded => {
                text.push(format!(
                    "The model lacks {}{}, or an effect that these data cannot distinguish from it.",
                    list(&self.effects),
                    self.per_cent(&self.effects)
                ));
                let shown: Vec<String> = self
                    .confounded_with
                    .iter()
                    .take(MOST_SETS)
                    .map(|set| format!("{}{}", list(set), self.per_cent(set)))
                    .collect();
                let more = self.confounded_with.len() - shown.len();
                let more = if more > 0 { format!("; and {more} more sets") } else { String::new() };
                if !shown.is_empty() {
                    text.push(format!("It may also be: {}{more}.", shown.join("; ")));
                }
            }
            Verdict::Unknown => {
                text.push("Something is missing that no effect of the catalogue explains.".to_owned());
            }
            Verdict::NothingMissing => {
                text.push("Nothing is missing: the model, its own parameters refitted, explains the data to the noise.".to_owned());
                if let Some(best) = self.candidates.iter().find(|c| !c.parameters.is_empty()) {
                    text.push(format!(
                        "Effects of ordinary size would have shown; for example {} from {}.",
                        title(&best.effect),
                        best.parameters.first().map_or_else(String::new, |p| format!(
                            "{} = {:.1e}{}",
                            p.name,
                            p.smallest_detectable,
                            behind(&p.unit)
                        ))
                    ));
                }
            }
            Verdict::NotEnoughInformation => {
                text.push("These data cannot show whether an effect is missing.".to_owned());
                let likely: Vec<String> = self
                    .explanations
                    .iter()
                    .take(MOST_SETS)
                    .map(|e| format!("{} {}", e.title(), percent(e.probability)))
                    .collect();
                if likely.len() > 1 {
                    text.push(format!("Of what was compared: {}.", likely.join("; ")));
                }
            }
        }
        if let Some(unknown) = &self.unknown {
            if !self.effects.is_empty() {
                text.push(
                    "Something else is missing beside that, which no effect of the catalogue explains."
                        .to_owned(),
                );
            }
            text.extend(unknown.sentences());
        }
        for id in &self.effects {
            if let Some(candidate) = row(id) {
                text.push(format!("{id}: {}.", sizes(candidate)));
            }
        }
        if !self.effects.is_empty() {
            let slow = &self.slow_residual;
            let held = match (slow.held_out_before, slow.held_out_after) {
                (Some(before), Some(after)) => {
                    format!(", and on held-out runs from {before:.2} to {after:.2}")
                }
                _ => String::new(),
            };
            text.push(format!(
                "With it the slow residual (whitened, summed over 1 and 8 s; 1 = noise) falls from {:.2} to {:.2}{held}.",
                slow.before, slow.after
            ));
        }
        if self.background.stddev_n_m > 0.0 {
            text.push(format!(
                "Beside it a slow random torque of {} N m, which changes over {} s, is taken into account.",
                three_digits(self.background.stddev_n_m),
                three_digits(self.background.correlation_s)
            ));
        }
        if !self.odd_runs.is_empty() {
            text.push(format!("Disagrees with the other runs: {}.", self.odd_runs.join(", ")));
        }
        if let Some(next) = &self.next {
            text.push(format!("Next: {}.", next.manoeuvre));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::behind;

    #[test]
    fn a_plain_number_has_no_unit() {
        assert_eq!([behind("1"), behind("N m")], ["", " N m"]);
    }
}
