//! The one function that finds what a model lacks, and its options.

use whorl_dynamics::effects::find;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use crate::case::{Case, is_blind};
use crate::selection::Selection;
use crate::verdict::answer::answer;
use crate::verdict::missing_channels;
use crate::{Diagnosis, DiagnosisError, Settings};

/// Options of a diagnosis; [`Options::default`] suits most cases.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Effects to exclude, by their ids.
    pub exclude: Vec<String>,
    /// 1: everything on one thread; more: on those of the computer. Results do not depend on it.
    pub threads: usize,
    /// Largest number of effects that are named together.
    pub largest_set: usize,
    /// The model with those low-passes that the samples show to delay: [`Diagnosis::delaying`]. `None`: it is found, which takes as long as a fit.
    pub delaying: Option<PlatformModel>,
    /// Numbers that the verdict depends on; there is rarely a reason to change one.
    pub settings: Settings,
}

impl Default for Options {
    fn default() -> Self {
        let settings = Settings::default();
        Self { exclude: Vec::new(), threads: 2, largest_set: 3, delaying: None, settings }
    }
}

/// Progress of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Share done, 0 to 1.
    pub share: f64,
    /// The current step.
    pub doing: &'static str,
}

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
