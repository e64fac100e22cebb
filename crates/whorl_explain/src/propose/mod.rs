//! The manoeuvre that best separates the remaining explanations.

mod demand;
mod experiment;
mod family;
#[cfg(test)]
mod tests;
mod words;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use whorl_dynamics::PlatformModel;
use whorl_identification::{Diagnosis, ExpectedInformation, Options, Verdict, expected_information, fit};
use whorl_recording::{Mounting, Recording};

pub use demand::ManoeuvreDemand;
pub use experiment::yaml;
pub use family::{Envelope, Manoeuvre, family};
pub use words::{log_odds_in_words, needs_run};

use crate::{Case, ExplainError, ProgressCallback};

/// How often a manoeuvre beyond the limits is scaled down, and by how much each time.
const ATTEMPTS: usize = 4;
const SMALLER: f64 = 0.75;
/// Increase of the probability of separating explanations that outweighs a shorter run.
const STEPS: f64 = 20.0;

/// A manoeuvre with its expected information.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// The limits within which it is planned.
    pub envelope: Envelope,
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
    /// All manoeuvres within the limits, best first.
    pub judged: Vec<Judged>,
    /// Manoeuvres beyond the limits, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Whether the aim is to separate explanations; otherwise it is to show more effects.
    pub separates: bool,
}

impl Proposal {
    /// The best manoeuvre.
    #[must_use]
    pub fn best(&self) -> Option<&Judged> {
        self.judged.first()
    }
}

/// Simulates an experiment, given by its name and the text of its file, on the platform of [`leading_explanation`], and
/// returns the recording, or the reason why it cannot be simulated.
pub type Rehearse<'a> = dyn Fn(&str, &str) -> Result<Recording, String> + Sync + 'a;

/// The platform for rehearsals: the fit of the leading explanation, or the model as given if it cannot be fitted.
#[must_use]
pub fn leading_explanation(case: &Case<'_>, diagnosis: &Diagnosis, options: &Options) -> PlatformModel {
    let ids: Vec<&str> = diagnosis.effects.iter().map(String::as_str).collect();
    if let Some(known) = diagnosis.fits.get(&diagnosis.effects) {
        return known.model.clone();
    }
    let fitted = fit(case.training, case.model, case.prior, &ids, options);
    fitted.map_or_else(|_| case.model.clone(), |fitted| fitted.model)
}

/// Rehearses every manoeuvre of the family on `platform`, and evaluates the information that each would add to the data
/// at hand.
///
/// # Errors
/// For a clamped platform, one that cannot make any of the manoeuvres within its limits, and where a manoeuvre cannot
/// be simulated.
pub fn propose(
    case: &Case<'_>,
    platform: &str,
    diagnosis: &Diagnosis,
    options: &Options,
    rehearse: &Rehearse<'_>,
    say: &mut ProgressCallback<'_>,
) -> Result<Proposal, ExplainError> {
    if case.training.iter().all(|r| r.mounting == Mounting::Clamped) {
        return Err(ExplainError::Clamped);
    }
    let explanations = diagnosis.contenders();
    say(0.0, "rehearsing manoeuvres in simulation");
    let count = family(&Envelope::of(case.model, 1.0)).len();
    let rehearsals: Vec<_> =
        (0..count).into_par_iter().map(|index| rehearsed(rehearse, platform, case.model, index)).collect();
    let (mut tried, mut left_out) = (Vec::new(), Vec::new());
    for rehearsal in rehearsals {
        match rehearsal? {
            Ok(found) => tried.push(found),
            Err(beyond) => left_out.push(beyond),
        }
    }
    if tried.is_empty() {
        let reasons: Vec<String> = left_out.iter().map(|(name, reason)| format!("{name} {reason}")).collect();
        return Err(ExplainError::NoManoeuvre(reasons.join("; ")));
    }
    say(0.5, "evaluating the manoeuvres");
    let further: Vec<Recording> = tried.iter().map(|tried| tried.motion.clone()).collect();
    let found =
        expected_information(case.training, &further, case.model, case.prior, &explanations, options)?;
    let with = tried.into_iter().zip(found.with);
    let mut judged: Vec<Judged> = with.map(|(tried, expected)| Judged { expected, ..tried }).collect();
    let separates =
        matches!(diagnosis.verdict, Verdict::Confounded | Verdict::Named) && found.now.log_odds.is_some();
    let worth = |j: &Judged| {
        let odds = (STEPS * j.expected.told_apart.unwrap_or(0.0)).round();
        let shown = j.expected.shown.len() as f64;
        let short = -j.demand.duration_s;
        if separates { [odds, short, shown] } else { [shown, odds, short] }
    };
    judged.sort_by(|a, b| {
        let pairs = worth(b).into_iter().zip(worth(a));
        pairs.map(|(b, a)| b.total_cmp(&a)).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(Proposal { explanations, now: found.now, judged, left_out, separates })
}

/// Simulates a manoeuvre, scaled down if necessary; what it is expected to show is left open. Its name and the exceeded limit where
/// none stays within the limits.
fn rehearsed(
    rehearse: &Rehearse<'_>,
    platform: &str,
    model: &PlatformModel,
    index: usize,
) -> Result<Result<Judged, (String, String)>, ExplainError> {
    let (mut scale, mut beyond) = (1.0, (String::new(), String::new()));
    for _ in 0..ATTEMPTS {
        let envelope = Envelope::of(model, scale);
        let Some(manoeuvre) = family(&envelope).into_iter().nth(index) else { break };
        let name = manoeuvre.name.to_owned();
        let text = yaml(&name, platform, &envelope, &manoeuvre, &[]);
        let motion = rehearse(&name, &text)
            .map_err(|reason| ExplainError::Rehearsal { name: name.clone(), reason })?;
        let demand = ManoeuvreDemand::of(&motion, model);
        let Some(objection) = demand.objection() else {
            let expected = ExpectedInformation::default();
            return Ok(Ok(Judged { manoeuvre, envelope, demand, expected, motion }));
        };
        beyond = (name, objection);
        scale *= SMALLER;
    }
    Ok(Err(beyond))
}
