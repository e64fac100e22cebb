//! Which physical effect a model lacks.

use whorl_identification::{Diagnosis, Options, Progress, Verdict, usable_readings};
use whorl_recording::Mounting;
use whorl_validation::{SMALL_ERROR, UnexplainedTorques, unexplained_torques};

use crate::adopt::{Version, versions};
use crate::locate::check_plausible;
use crate::{Case, ExplainError, ProgressCallback, part};

/// A verdict with the numbers behind it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The verdict.
    pub diagnosis: Diagnosis,
    /// The model as given, with its own parameters refitted, and with the named effects, each compared with
    /// all runs by [`crate::compare`]. Versions that could not be fitted are left out.
    pub versions: Vec<Version>,
    /// Unexplained torque of the first run; `None` for a clamped one.
    pub torque: Option<UnexplainedTorque>,
}

/// The unexplained torque of one run, without and with the named effects. The platform's own parameters are refitted
/// in both cases, unless they would have to move implausibly far.
#[derive(Debug, Clone, PartialEq)]
pub struct UnexplainedTorque {
    /// Name of the run.
    pub run: String,
    /// Without the named effects.
    pub before: UnexplainedTorques,
    /// With the named effects; `None` if there are none.
    pub after: Option<UnexplainedTorques>,
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
    let mut search = part(say, 0.1, 0.7);
    let mut progress = |p: Progress| search(p.share, p.doing);
    let diagnosis = whorl_identification::diagnose(training, held_out, model, prior, options, &mut progress)?;
    drop(search);
    let named = (!diagnosis.effects.is_empty()).then(|| diagnosis.effects.clone());
    let sets: Vec<Vec<String>> = named.iter().cloned().collect();
    let (versions, _) = versions(case, &sets, &diagnosis.fits, options, &mut part(say, 0.7, 1.0))?;
    let best = versions.iter().rfind(|version| named.is_none() || !version.effects.is_empty());
    let left = |held_out: bool| best.and_then(|version| version.prediction_error(held_out));
    let diagnosis = diagnosis.held_against(left(false), left(true), &options.settings);
    let torque = unexplained(case, &versions);
    Ok(Explanation { diagnosis, versions, torque })
}

/// Unexplained torque of the first run with the refitted model, and with the effects added.
fn unexplained(case: &Case<'_>, versions: &[Version]) -> Option<UnexplainedTorque> {
    let recording = case.training.first().filter(|run| run.mounting != Mounting::Clamped)?;
    if !case.model.freedom.turns() {
        return None;
    }
    let torques = |version: &Version| {
        let model = version.fit.as_ref().map_or(case.model, |fit| &fit.model);
        let known = version.runs.first().map(|run| &run.comparison.followed);
        unexplained_torques(&usable_readings(recording, case.model).0, model, known).ok()
    };
    // Parameters moved implausibly far would hide or imitate the missing effect.
    let is_plausible =
        |version: &&Version| version.fit.as_ref().is_none_or(|fit| check_plausible(fit).is_ok());
    let (with, without): (Vec<&Version>, Vec<&Version>) =
        versions.iter().partition(|version| !version.effects.is_empty());
    let before = torques(without.into_iter().rfind(is_plausible)?)?;
    let after = with.first().and_then(|version| torques(version));
    Some(UnexplainedTorque { run: recording.name.clone(), before, after })
}

impl Explanation {
    /// The verdict in a few sentences, most important first, with the prediction error of each version.
    #[must_use]
    pub fn answer(&self) -> Vec<String> {
        let mut answer = self.diagnosis.answer();
        let list = |held_out: bool| -> Vec<String> {
            let error = |v: &Version| Some(format!("{} {:.2}", v.name, v.prediction_error(held_out)?));
            self.versions.iter().filter_map(error).collect()
        };
        for (held_out, kind) in [(false, "training"), (true, "held-out")] {
            let errors = list(held_out);
            if !errors.is_empty() {
                answer.push(format!(
                    "Prediction error on {kind} runs, times the noise: {}.",
                    errors.join(", ")
                ));
            }
        }
        answer.extend(self.said_of_size());
        answer
    }

    /// How much the model is off without what it lacks, where that is little: that something is missing, and how much it matters, are
    /// two statements.
    fn said_of_size(&self) -> Option<String> {
        let base = self.versions.iter().rfind(|version| version.effects.is_empty())?;
        let error = base.prediction_error(true).or_else(|| base.prediction_error(false))?;
        let lacks =
            !matches!(self.diagnosis.verdict, Verdict::NothingMissing | Verdict::NotEnoughInformation);
        in_size(lacks, error, &base.name)
    }
}

/// That what is missing is small; `error`: of predictions without it, over noise.
fn in_size(lacks: bool, error: f64, name: &str) -> Option<String> {
    (lacks && error <= 1.0 + SMALL_ERROR).then(|| {
        let percent = (100.0 * (error - 1.0)).ceil().max(1.0);
        format!(
            "What is missing is significant, and small: {name}, the model predicts within {percent} % of what noise allows."
        )
    })
}

#[cfg(test)]
mod tests {
    use super::in_size;

    #[test]
    fn how_much_is_missing_is_told_apart_from_whether_something_is() {
        let said = in_size(true, 1.013, "base refitted").unwrap();
        assert_eq!(
            said,
            "What is missing is significant, and small: base refitted, the model predicts within 2 % of what noise allows."
        );
        assert!(in_size(true, 0.99, "base refitted").unwrap().contains("within 1 %"));
        assert_eq!(in_size(true, 1.15, "base refitted"), None, "large");
        assert_eq!(in_size(false, 1.0, "base refitted"), None, "nothing is missing");
    }
}
