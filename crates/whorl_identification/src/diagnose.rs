//! The one function that finds what a model lacks.

use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::case::{Case, is_blind};
use crate::selection::Selection;
use crate::verdict::answer::answer;
use crate::verdict::missing_channels;
use crate::{Diagnosis, DiagnosisError, Options, Progress};

/// Finds the effect that the model lacks. `held_out` recordings are used to test, never to fit. `progress` is called repeatedly from this thread.
///
/// # Errors
/// If the recordings cannot be analysed: see [`DiagnosisError`].
pub fn diagnose(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    progress(Progress { share: 0.0, doing: "reading the recordings" });
    if training.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    for id in &options.exclude {
        find(id).ok_or_else(|| DiagnosisError::UnknownEffect(id.clone()))?;
    }
    progress(Progress { share: 0.02, doing: "comparing what the sensors' low-pass may be" });
    let case = Case::new(training, held_out, model, prior, options)?;
    let mut diagnosis = match case.training.iter().find(|run| is_blind(run, model)) {
        // Without measured wheel speeds a gyro alone says nothing of what is missing.
        Some(blind) => {
            let mut remarks: Vec<String> =
                case.training.iter().flat_map(|run| missing_channels(run, model)).collect();
            remarks.push(format!(
                "{}: the gyro alone, without measured wheel speeds, cannot distinguish a missing effect from the wheels' momentum and the tilt; record the wheel speeds, the accelerometer or a vector sensor",
                blind.name
            ));
            Diagnosis { remarks, ..Diagnosis::not_enough_information() }
        }
        None => {
            let selection = Selection::new(case.runs(), options, progress)?;
            progress(Progress { share: 0.9, doing: "looking for laws without a name, writing the answer" });
            let mut diagnosis = answer(&selection, (training, held_out), options)?;
            diagnosis.remarks.extend(case.remarks.iter().cloned());
            diagnosis
        }
    };
    diagnosis.delaying = Some(case.reference.model);
    Ok(diagnosis)
}
