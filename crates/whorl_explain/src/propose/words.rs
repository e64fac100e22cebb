//! A proposal in words.

use whorl_dynamics::effects::find;
use whorl_identification::Verdict;

use super::{Judged, Proposal};

/// Log odds above which an explanation counts as decided.
const DECIDED: f64 = 6.0;

/// Log odds; the digits of large ones are meaningless.
#[must_use]
pub fn log_odds_in_words(odds: f64) -> String {
    if odds > 1000.0 { "> 1000".to_owned() } else { format!("{odds:.1}") }
}

fn title(set: &[String]) -> String {
    if set.is_empty() {
        return "the current model".to_owned();
    }
    let one = |id: &String| find(id).map_or_else(|| id.clone(), |e| format!("{} ({id})", e.info().title));
    set.iter().map(one).collect::<Vec<_>>().join(" with ")
}

/// Whether anything is in doubt that a further run may decide.
#[must_use]
pub fn needs_run(verdict: Verdict) -> bool {
    match verdict {
        Verdict::Confounded | Verdict::Unknown | Verdict::NotEnoughInformation => true,
        Verdict::Named | Verdict::NothingMissing => false,
    }
}

impl Proposal {
    /// The proposal, the reasons, and the demands on the platform.
    #[must_use]
    pub fn answer(&self, best: &Judged, verdict: Verdict, platform: &str) -> Vec<String> {
        let design = self;
        let mut text = Vec::new();
        let sets: Vec<String> = design.explanations.iter().map(|s| title(s)).collect();
        let odds = best.expected.log_odds.unwrap_or(0.0);
        let now = design.now.log_odds.unwrap_or(0.0);
        text.push(match verdict {
        Verdict::Confounded => {
            format!("The data leave open: {} (log odds now {}).", sets.join("; or "), log_odds_in_words(now))
        }
        Verdict::Named => format!(
            "No run is needed: the data name {}.{}",
            sets.first().map_or("", String::as_str),
            sets.get(1).map_or_else(String::new, |other| format!(" A further one can only confirm it, for example against {other}."))
        ),
        Verdict::Unknown => "Something is missing that no effect explains. A run that can show more effects can rule out more of them.".to_owned(),
        Verdict::NothingMissing => format!(
            "No run is needed: nothing is missing, and {} of {} effects would have shown at their ordinary size.",
            design.now.shown.len(),
            design.now.shown.len() + design.now.not_shown.len()
        ),
        Verdict::NotEnoughInformation => format!(
            "The data cannot say whether an effect is missing: only {} of {} would have shown at their ordinary size.",
            design.now.shown.len(),
            design.now.shown.len() + design.now.not_shown.len()
        ),
    });
        let next = if needs_run(verdict) { "Next" } else { "If you make one all the same" };
        text.push(format!("{next}: {platform} {} ({}).", best.manoeuvre.words, best.manoeuvre.name));
        if design.separates {
            let worth = format!(
                "Whichever is true, it is expected to lead by {} in log odds",
                log_odds_in_words(odds)
            );
            text.push(if odds >= DECIDED {
            format!("{worth}, which decides.")
        } else if odds > 0.5 {
            format!("{worth}. One run does not decide; {:.0} would.", (DECIDED / odds).ceil())
        } else {
            format!("{worth}. No manoeuvre of the family separates them on this platform: at their present size they predict the same.")
        });
        } else {
            text.push(format!(
                "With it {} of {} effects would show at their ordinary size.",
                best.expected.shown.len(),
                best.expected.shown.len() + best.expected.not_shown.len()
            ));
            let new: Vec<&str> = best
                .expected
                .shown
                .iter()
                .filter(|id| !design.now.shown.contains(id))
                .map(String::as_str)
                .collect();
            if !new.is_empty() {
                text.push(format!("New among them: {}.", new.join(", ")));
            }
        }
        let d = &best.demand;
        text.push(format!(
        "In simulation it takes {:.0} s, tilts by up to {:.1} of {:.1} deg, turns at up to {:.1} deg/s, brings the wheels to {:.0} % of their speed, and uses {:.1} % of a full tank.",
        d.duration_s,
        d.tilt_deg,
        d.tilt_limit_deg,
        d.rate_deg_s,
        100.0 * d.wheel_speed_share,
        100.0 * d.gas_share
    ));
        text
    }
}
