//! The manoeuvre that best separates the remaining explanations.

mod demand;
mod family;
#[cfg(test)]
mod tests;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_identification::{Diagnosis, ExpectedInformation, Options, Verdict, expected_information};
use whorl_recording::{Mounting, Recording};

pub use demand::ManoeuvreDemand;
pub use family::{Manoeuvre, family};

use crate::{Case, ExplainError, ProgressCallback};

/// Shares of its full size to which a manoeuvre beyond the limits is scaled down.
const SCALES: [f64; 4] = [1.0, 0.75, 0.56, 0.42];
/// Increase of the probability of separating explanations that outweighs a shorter run.
const STEPS: f64 = 20.0;

/// Log odds above which an explanation counts as decided.
const DECIDED: f64 = 6.0;
const CLAMPED: &str = "all runs are of a clamped platform, and manoeuvres are designed for a free one: for a bench test let every wheel coast down from full speed to both sides, then brake it through zero";

/// A manoeuvre with its expected information.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// Its demands on the platform.
    pub demand: ManoeuvreDemand,
    /// Its expected information.
    pub expected: ExpectedInformation,
    /// Its motion in simulation.
    pub motion: Recording,
}

/// The proposal and the alternatives.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// The sets of effects to separate; the empty set is the current model.
    pub explanations: Vec<Vec<String>>,
    /// Information in the data at hand.
    pub now: ExpectedInformation,
    /// All manoeuvres within the limits, best first; at least one.
    pub judged: Vec<Judged>,
    /// Manoeuvres that cannot be simulated or are beyond the limits, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Whether the aim is to separate explanations; otherwise it is to show more effects.
    pub separates: bool,
}

/// Simulates an experiment, given by its name and the text of its file, on the platform of [`leading_explanation`], and
/// returns the recording, or the reason why it cannot be simulated.
pub type Rehearse<'a> = dyn Fn(&str, &str) -> Result<Recording, String> + Sync + 'a;

/// The platform for rehearsals: the fit of the leading explanation, or the model as given without one.
#[must_use]
pub fn leading_explanation<'a>(case: &Case<'a>, diagnosis: &'a Diagnosis) -> &'a PlatformModel {
    diagnosis.fits.get(&diagnosis.effects).map_or(case.model, |fit| &fit.model)
}

/// Rehearses every manoeuvre of the family on `platform`, and evaluates the information that each would add to the data
/// at hand.
///
/// # Errors
/// For a clamped platform, and one that cannot make any of the manoeuvres within its limits.
pub fn propose(
    case: &Case<'_>,
    platform: &str,
    diagnosis: &Diagnosis,
    options: &Options,
    rehearse: &Rehearse<'_>,
    say: &mut ProgressCallback<'_>,
) -> Result<Proposal, ExplainError> {
    if case.training.iter().all(|run| run.mounting == Mounting::Clamped) {
        return Err(ExplainError::NoManoeuvre(CLAMPED.to_owned()));
    }
    say(0.0, "rehearsing manoeuvres in simulation");
    let count = family(case.model, 1.0).len();
    let one = |index: usize| rehearsed(rehearse, platform, case.model, index);
    let rehearsals: Vec<_> = (0..count).into_par_iter().map(one).collect();
    let (mut judged, mut left_out) = (Vec::new(), Vec::new());
    for rehearsal in rehearsals {
        match rehearsal {
            Ok(found) => judged.push(found),
            Err(beyond) => left_out.push(beyond),
        }
    }
    if judged.is_empty() {
        let reasons: Vec<String> = left_out.iter().map(|(name, reason)| format!("{name} {reason}")).collect();
        return Err(ExplainError::NoManoeuvre(reasons.join("; ")));
    }
    say(0.5, "evaluating the manoeuvres");
    let further: Vec<Recording> = judged.iter().map(|judged| judged.motion.clone()).collect();
    let explanations = diagnosis.contenders();
    let found =
        expected_information(case.training, &further, case.model, case.prior, &explanations, options)?;
    judged.iter_mut().zip(found.with).for_each(|(judged, expected)| judged.expected = expected);
    let separates =
        matches!(diagnosis.verdict, Verdict::Confounded | Verdict::Named) && found.now.log_odds.is_some();
    let worth = |j: &Judged| {
        let odds = (STEPS * j.expected.told_apart.unwrap_or(0.0)).round();
        let (shown, short) = (j.expected.shown.len() as f64, -j.demand.duration_s);
        if separates { [odds, short, shown] } else { [shown, odds, short] }
    };
    judged.sort_by(|a, b| worth(b).partial_cmp(&worth(a)).unwrap_or(std::cmp::Ordering::Equal));
    Ok(Proposal { explanations, now: found.now, judged, left_out, separates })
}

/// Simulates a manoeuvre, scaled down if necessary; what it is expected to show is left open. Its name and why not where it cannot be
/// simulated or no scale stays within the limits.
fn rehearsed(
    rehearse: &Rehearse<'_>,
    platform: &str,
    model: &PlatformModel,
    index: usize,
) -> Result<Judged, (String, String)> {
    let mut beyond = (String::new(), String::new());
    for scale in SCALES {
        let Some(manoeuvre) = family(model, scale).into_iter().nth(index) else { break };
        let name = manoeuvre.name.to_owned();
        let motion = match rehearse(&name, &manoeuvre.yaml(&name, platform, &[])) {
            Ok(motion) => motion,
            Err(reason) => return Err((name, format!("cannot be simulated: {reason}"))),
        };
        let demand = ManoeuvreDemand::of(&motion, model);
        match demand.objection() {
            None => {
                return Ok(Judged { manoeuvre, demand, expected: ExpectedInformation::default(), motion });
            }
            Some(objection) => beyond = (name, objection),
        }
    }
    Err(beyond)
}

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
    !matches!(verdict, Verdict::Named | Verdict::NothingMissing)
}

impl Proposal {
    /// The proposal, the reasons, and the demands on the platform.
    #[must_use]
    pub fn answer(&self, best: &Judged, verdict: Verdict, platform: &str) -> Vec<String> {
        let sets: Vec<String> = self.explanations.iter().map(|set| title(set)).collect();
        let odds = |of: &ExpectedInformation| of.log_odds.unwrap_or(0.0);
        let shown = |of: &ExpectedInformation| {
            format!("{} of {}", of.shown.len(), of.shown.len() + of.not_shown.len())
        };
        let why = match verdict {
            Verdict::Confounded => {
                format!("The data leave open: {} (log odds now {}).", sets.join("; or "), log_odds_in_words(odds(&self.now)))
            }
            Verdict::Named => format!(
                "No run is needed: the data name {}.{}",
                sets.first().map_or("", String::as_str),
                sets.get(1).map_or_else(String::new, |other| {
                    format!(" A further one can only confirm it, for example against {other}.")
                })
            ),
            Verdict::Unknown => "Something is missing that no effect explains. A run that can show more effects can rule out more of them.".to_owned(),
            Verdict::NothingMissing => format!(
                "No run is needed: nothing is missing, and {} effects would have shown at their ordinary size.",
                shown(&self.now)
            ),
            Verdict::NotEnoughInformation => format!(
                "The data cannot say whether an effect is missing: only {} would have shown at their ordinary size.",
                shown(&self.now)
            ),
        };
        let next = if needs_run(verdict) { "Next" } else { "If you make one all the same" };
        let next = format!("{next}: {platform} {} ({}).", best.manoeuvre.words, best.manoeuvre.name);
        let worth = if self.separates {
            let odds = odds(&best.expected);
            let lead = format!(
                "Whichever is true, it is expected to lead by {} in log odds",
                log_odds_in_words(odds)
            );
            if odds >= DECIDED {
                format!("{lead}, which decides.")
            } else if odds > 0.5 {
                format!("{lead}. One run does not decide; {:.0} would.", (DECIDED / odds).ceil())
            } else {
                format!(
                    "{lead}. No manoeuvre of the family separates them on this platform: at their present size they predict the same."
                )
            }
        } else {
            let new = best.expected.shown.iter().filter(|id| !self.now.shown.contains(id));
            let new: Vec<&str> = new.map(String::as_str).collect();
            let named =
                if new.is_empty() { String::new() } else { format!(" New among them: {}.", new.join(", ")) };
            format!("With it {} effects would show at their ordinary size.{named}", shown(&best.expected))
        };
        let d = &best.demand;
        let demand = format!(
            "In simulation it takes {:.0} s, tilts by up to {:.1} of {:.1} deg, turns at up to {:.1} deg/s, brings the wheels to {:.0} % of their speed, and uses {:.1} % of a full tank.",
            d.duration_s,
            d.tilt_deg,
            d.tilt_limit_deg,
            d.rate_deg_s,
            100.0 * d.wheel_speed_share,
            100.0 * d.gas_share
        );
        vec![why, next, worth, demand]
    }
}
