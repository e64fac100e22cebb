//! The answer in words.

use whorl_dynamics::effects::find;

use crate::diagnosis::Candidate;
use crate::{Diagnosis, Verdict};

/// So many sets that explain the data as well are read out; all of them are in `confounded_with`.
const MOST_SETS: usize = 5;

fn title(id: &str) -> String {
    find(id).map_or_else(|| id.to_owned(), |e| format!("{} ({id})", e.info().title))
}

fn list(set: &[String]) -> String {
    set.iter().map(|id| title(id)).collect::<Vec<_>>().join(" and ")
}

fn sizes(candidate: &Candidate) -> String {
    let mut parts: Vec<String> = candidate
        .parameters
        .iter()
        .take(4)
        .map(|p| {
            let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
            format!("{} = {:.3e} +- {:.1e}{unit}", p.name, p.estimate, p.stddev)
        })
        .collect();
    if candidate.parameters.len() > 4 {
        parts.push("...".to_owned());
    }
    parts.join(", ")
}

impl Diagnosis {
    /// The verdict in a few sentences, most important first.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let mut text = Vec::new();
        let row = |id: &String| self.candidates.iter().find(|c| c.effect == *id);
        match self.verdict {
            Verdict::Named => {
                text.push(format!("The model lacks: {}.", list(&self.effects)));
            }
            Verdict::Confounded => {
                text.push(format!(
                    "The model lacks {}, or an effect that these data cannot distinguish from it.",
                    list(&self.effects)
                ));
                let shown: Vec<String> =
                    self.confounded_with.iter().take(MOST_SETS).map(|set| list(set)).collect();
                let more = self.confounded_with.len() - shown.len();
                let more = if more > 0 { format!("; and {more} more sets") } else { String::new() };
                text.push(format!("Equally well supported: {}{more}.", shown.join("; ")));
            }
            Verdict::Unknown => {
                text.push("Something is missing that no effect of the catalogue explains.".to_owned());
                if let Some(u) = &self.unknown {
                    let line = u.frequency_hz.map_or_else(String::new, |f| format!(", a line at {f:.3} Hz"));
                    let parity =
                        if u.parity == "none" { String::new() } else { format!(", {} symmetry", u.parity) };
                    text.push(format!(
                        "The residual correlates best with {}{parity}{line}, about {} of the {} frame; this explains {:.0} % of the excess.",
                        u.variable, u.axis, u.frame, 100.0 * u.share
                    ));
                }
            }
            Verdict::NothingMissing => {
                text.push("Nothing is missing: the model, its own parameters refitted, explains the data to the noise.".to_owned());
                if let Some(best) = self.candidates.iter().find(|c| !c.parameters.is_empty()) {
                    text.push(format!(
                        "Effects of ordinary size would have shown; for example {} from {}.",
                        title(&best.effect),
                        best.parameters.first().map_or_else(String::new, |p| format!(
                            "{} = {:.1e} {}",
                            p.name, p.smallest_detectable, p.unit
                        ))
                    ));
                }
            }
            Verdict::NotEnoughInformation => {
                text.push("These data cannot show whether an effect is missing.".to_owned());
            }
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
        if !self.odd_runs.is_empty() {
            text.push(format!("Disagrees with the other runs: {}.", self.odd_runs.join(", ")));
        }
        if let Some(next) = &self.next {
            text.push(format!("Next: {}.", next.manoeuvre));
        }
        text
    }
}
