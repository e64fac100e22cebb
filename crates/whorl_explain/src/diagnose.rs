//! Which physical effect a model lacks.

use whorl_diagnosis::{Diagnosis, Options, Progress};
use whorl_recording::Mounting;
use whorl_validation::{UnexplainedTorques, unexplained_torques};

use crate::adopt::{Values, Version, versions};
use crate::locate::believed;
use crate::{Case, ExplainError, Say, part};

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
pub fn diagnose(case: &Case<'_>, options: &Options, say: &mut Say<'_>) -> Result<Explanation, ExplainError> {
    let Case { training, held_out, model, prior } = *case;
    say(0.0, "comparing what the sensors' low-pass may be");
    let delaying = whorl_diagnosis::with_low_passes_that_delay(training, model, prior, options)?;
    let options = &Options { delaying: Some(delaying), ..options.clone() };
    let mut search = part(say, 0.1, 0.7);
    let mut progress = |p: Progress| search(p.share, p.doing);
    let diagnosis = whorl_diagnosis::diagnose(training, held_out, model, prior, options, &mut progress)?;
    drop(search);
    let named = (!diagnosis.effects.is_empty()).then(|| diagnosis.effects.clone());
    let sets: Vec<Vec<String>> = named.into_iter().collect();
    let (versions, _) = versions(case, &sets, Values::Rough, options, &mut part(say, 0.7, 1.0))?;
    let torque = unexplained(case, &versions);
    Ok(Explanation { diagnosis, versions, torque })
}

/// Unexplained torque of the first run with the refitted model, and with the effects added.
fn unexplained(case: &Case<'_>, versions: &[Version]) -> Option<UnexplainedTorque> {
    let recording = case.training.first().filter(|run| run.mounting != Mounting::Clamped)?;
    if !case.model.freedom.turns() {
        return None;
    }
    let fit = |with_effects: bool| {
        versions.iter().filter(|v| v.effects.is_empty() != with_effects).find_map(|v| v.fit.as_ref())
    };
    // Parameters moved implausibly far would hide or imitate the missing effect.
    let base = fit(false).filter(|fit| believed(case, fit).is_ok()).map_or(case.model, |fit| &fit.model);
    let before = unexplained_torques(recording, base).ok()?;
    let after = fit(true).and_then(|fit| unexplained_torques(recording, &fit.model).ok());
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
        answer
    }
}
