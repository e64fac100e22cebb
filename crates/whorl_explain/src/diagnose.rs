//! Which physical effect a model lacks.

use whorl_identification::{Diagnosis, Fit, Options, Progress, Verdict, usable_readings};
use whorl_recording::Mounting;
use whorl_validation::{SMALL_ERROR, UnexplainedTorques, unexplained_torques};

use crate::adopt::{Adoption, Version, implausible, prediction_errors, versions};
use crate::locate::MOST_STDDEVS;
use crate::{Case, ExplainError, ProgressCallback, part};

/// A verdict with the numbers behind it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The verdict.
    pub diagnosis: Diagnosis,
    /// The model as given, with its own parameters refitted, and with the named effects, each compared with
    /// all runs by [`crate::compare`]. Versions that could not be fitted are left out.
    pub versions: Vec<Version>,
    /// Unexplained torque of the first run, without and with the named effects; empty for a clamped one. The platform's own parameters
    /// are refitted in both cases, unless they would have to move implausibly far.
    pub torques: Vec<UnexplainedTorques>,
}

/// Finds the effect that the model lacks, and compares the runs with the model that has it.
///
/// # Errors
/// When the recordings cannot be explained at all.
pub fn diagnose(
    case: &Case<'_>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Explanation, ExplainError> {
    let Case { training, held_out, model, prior } = *case;
    say(0.0, "comparing what the sensors' low-pass may be");
    let delaying = whorl_identification::with_low_passes_that_delay(training, model, prior, options)?;
    let options = &Options { delaying: Some(delaying), ..options.clone() };
    let mut progress = |p: Progress| say(0.1 + 0.6 * p.share, p.doing);
    let diagnosis = whorl_identification::diagnose(training, held_out, model, prior, options, &mut progress)?;
    let named = diagnosis.effects.clone();
    let sets = if named.is_empty() { &[][..] } else { std::slice::from_ref(&named) };
    let Adoption { versions, .. } = versions(case, sets, &diagnosis.fits, options, &mut part(say, 0.7, 1.0))?;
    let best = versions.iter().rfind(|version| named.is_empty() || !version.effects.is_empty());
    let left = |held_out: bool| best.and_then(|version| version.prediction_error(held_out));
    let diagnosis = diagnosis.held_against(left(false), left(true), &options.settings);
    let torques = unexplained(case, &versions);
    Ok(Explanation { diagnosis, versions, torques })
}

fn unexplained(case: &Case<'_>, versions: &[Version]) -> Vec<UnexplainedTorques> {
    let free = case.training.first().filter(|run| run.mounting != Mounting::Clamped);
    let Some(recording) = free.filter(|_| case.model.freedom.turns()) else { return Vec::new() };
    let torques = |version: &Version| {
        let model = version.fit.as_ref().map_or(case.model, |fit| &fit.model);
        let known = version.runs.first().map(|run| &run.comparison.followed);
        unexplained_torques(&usable_readings(recording, case.model).0, model, known).ok()
    };
    // Parameters moved implausibly far would hide or imitate the missing effect.
    let is_plausible = |fit: &Fit| implausible(fit, MOST_STDDEVS, |_| true).is_none();
    let is_before = |v: &&Version| v.effects.is_empty() && v.fit.as_ref().is_none_or(is_plausible);
    let before = versions.iter().rfind(is_before);
    let after = versions.iter().find(|version| !version.effects.is_empty());
    before.into_iter().chain(after).map_while(torques).collect()
}

impl Explanation {
    /// The verdict in a few sentences, most important first, with the prediction error of each version.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let mut answer = self.diagnosis.answer();
        answer.extend(prediction_errors(&self.versions));
        let base = self.versions.iter().rfind(|version| version.effects.is_empty());
        let lacks =
            !matches!(self.diagnosis.verdict, Verdict::NothingMissing | Verdict::NotEnoughInformation);
        answer.extend(base.filter(|_| lacks).and_then(|base| {
            said_of_size(base.prediction_error(true).or_else(|| base.prediction_error(false))?, &base.name)
        }));
        answer
    }
}

/// That what is missing is small, if it is: that something is missing, and how much it matters, are two statements. `error`: of
/// predictions without it, over noise.
fn said_of_size(error: f64, name: &str) -> Option<String> {
    (error <= 1.0 + SMALL_ERROR).then(|| {
        let percent = (100.0 * (error - 1.0)).ceil().max(1.0);
        format!(
            "What is missing is significant, and small: {name}, the model predicts within {percent} % of what noise allows."
        )
    })
}

#[cfg(test)]
mod tests {
    use super::said_of_size;

    #[test]
    fn how_much_is_missing_is_told_apart_from_whether_something_is() {
        let said = said_of_size(1.013, "base refitted").unwrap();
        assert_eq!(
            said,
            "What is missing is significant, and small: base refitted, the model predicts within 2 % of what noise allows."
        );
        assert!(said_of_size(0.99, "base refitted").unwrap().contains("within 1 %"));
        assert_eq!(said_of_size(1.15, "base refitted"), None, "large");
    }
}
