//! The answer in words.

use whorl_dynamics::effects::find;
use whorl_math::three_digits;

use crate::verdict::diagnosis::ParameterEstimate;
use crate::{Diagnosis, Explanation, Unknown, Verdict};

/// So many sets that explain the data as well are read out; all of them are in `confounded_with`.
const MOST_SETS: usize = 5;
/// Parameters of an effect that are read out.
const MOST_SIZES: usize = 4;

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

fn percent(probability: f64) -> String {
    match 100.0 * probability {
        p if p >= 99.5 => "over 99 %".to_owned(),
        p if p < 1.0 => "below 1 %".to_owned(),
        p => format!("{p:.0} %"),
    }
}

impl Explanation {
    fn title(&self) -> String {
        let unmodelled = self.with_unknown.then(|| "something unmodelled".to_owned());
        let parts: Vec<String> = self.effects.iter().map(|id| title(id)).chain(unmodelled).collect();
        if parts.is_empty() { "nothing is missing".to_owned() } else { parts.join(" and ") }
    }
}

impl Unknown {
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
        let mut text = vec![format!(
            "The residual correlates best with {}{parity}{line}, about {} of the {} frame{explains}.",
            self.variable, self.axis, self.frame
        )];
        if self.size > 0.0 {
            text.push(format!("Its size is {:.1e}{} (root mean square).", self.size, behind(&self.unit)));
        }
        text
    }
}

impl Diagnosis {
    /// A set with how probable it is, if it was evaluated.
    fn titled(&self, set: &[String]) -> String {
        let with_unknown = self.unknown.is_some();
        let own = self.explanations.iter().find(|e| e.with_unknown == with_unknown && e.effects == set);
        let percent = own.map_or_else(String::new, |e| format!(", {}", percent(e.probability)));
        format!("{}{percent}", list(set))
    }

    /// The verdict in a few sentences, most important first.
    pub fn answer(&self) -> Vec<String> {
        let mut text = self.verdict_sentences();
        if self.unknown.is_some() && !self.effects.is_empty() {
            text.push(
                "Something else is missing beside that, which no effect of the catalogue explains."
                    .to_owned(),
            );
        }
        text.extend(self.unknown.iter().flat_map(Unknown::sentences));
        for row in self.effects.iter().filter_map(|id| self.candidates.iter().find(|c| c.effect == *id)) {
            let size = |p: &ParameterEstimate| {
                format!("{} = {:.3e} +- {:.1e}{}", p.name, p.estimate, p.stddev, behind(&p.unit))
            };
            let more = (row.parameters.len() > MOST_SIZES).then(|| "...".to_owned());
            let sizes: Vec<String> = row.parameters.iter().take(MOST_SIZES).map(size).chain(more).collect();
            text.push(format!("{}: {}.", row.effect, sizes.join(", ")));
        }
        if !self.effects.is_empty() {
            let slow = &self.slow_residual;
            let held_out = slow.held_out_before.zip(slow.held_out_after);
            let held_out = held_out.map_or_else(String::new, |(before, after)| {
                format!(", and on held-out runs from {before:.2} to {after:.2}")
            });
            text.push(format!(
                "With it the slow residual (whitened, summed over 1 and 8 s; 1 = noise) falls from {:.2} to {:.2}{held_out}.",
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
        text.extend(self.next.iter().map(|next| format!("Next: {}.", next.manoeuvre)));
        text
    }

    fn verdict_sentences(&self) -> Vec<String> {
        let best = self.titled(&self.effects);
        let (first, second) = match self.verdict {
            Verdict::Named => (format!("The model lacks: {best}."), None),
            Verdict::Confounded => {
                let others = &self.confounded_with;
                let mut sets: Vec<String> =
                    others.iter().take(MOST_SETS).map(|set| self.titled(set)).collect();
                let more = others.len() - sets.len();
                sets.extend((more > 0).then(|| format!("and {more} more sets")));
                (
                    format!(
                        "The model lacks {best}, or an effect that these data cannot distinguish from it."
                    ),
                    (!sets.is_empty()).then(|| format!("It may also be: {}.", sets.join("; "))),
                )
            }
            Verdict::Unknown => {
                ("Something is missing that no effect of the catalogue explains.".to_owned(), None)
            }
            Verdict::NothingMissing => {
                let shown = self.candidates.iter().find_map(|row| Some((row, row.parameters.first()?)));
                let shown = shown.map(|(row, p)| {
                    let least = format!("{} = {:.1e}{}", p.name, p.smallest_detectable, behind(&p.unit));
                    let title = title(&row.effect);
                    format!("Effects of ordinary size would have shown; for example {title} from {least}.")
                });
                ("Nothing is missing: the model, its own parameters refitted, explains the data to the noise.".to_owned(), shown)
            }
            Verdict::NotEnoughInformation => {
                let likely = self.explanations.iter().take(MOST_SETS);
                let likely: Vec<String> =
                    likely.map(|e| format!("{} {}", e.title(), percent(e.probability))).collect();
                (
                    "These data cannot show whether an effect is missing.".to_owned(),
                    (likely.len() > 1).then(|| format!("Of what was compared: {}.", likely.join("; "))),
                )
            }
        };
        std::iter::once(first).chain(second).collect()
    }
}

#[cfg(test)]
mod tests;
