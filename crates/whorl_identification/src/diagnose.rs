//! The one function that finds what a model lacks.

use std::borrow::Cow;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Needs, check};
use whorl_recording::Recording;

use crate::fitting::low_pass;
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;
use crate::selection::{Runs, Selection};
use crate::signals::clamped::is_clamped;
use crate::signals::digits::without_clipped;
use crate::verdict::answer::answer;
use crate::verdict::missing_channels;
use crate::{Diagnosis, DiagnosisError, Options, Progress};

/// What is needed of a recording. Whether it holds enough is a matter of information, not of seconds.
const NEEDS: Needs = Needs { shortest_s: 0.5, free: false, accelerometer: false };

/// Finds the effect that the model lacks.
///
/// `held_out` recordings are used to test, never to fit. `progress` is called repeatedly from this thread.
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
        if whorl_dynamics::effects::find(id).is_none() {
            return Err(DiagnosisError::UnknownEffect { id: id.clone() });
        }
    }
    let given = Reference::new(model, prior, options.settings);
    let given_runs = (training, held_out);
    let (training, held_out) = (checked(training, model)?, checked(held_out, model)?);
    if let Some(blind) = training.iter().find(|run| is_blind(run, model)) {
        return Ok(nothing_of_a_blind_run(&training, model, &blind.name));
    }
    let available = Available::of(given_runs.0, model);
    progress(Progress { share: 0.02, doing: "comparing what the sensors' low-pass may be" });
    let delaying = delaying(&given, &available, &training, options)?;
    let reference = Reference { model: delaying, ..given };
    let runs = Runs {
        training: &training,
        held_out: &held_out,
        reference: &reference,
        available: &available,
        threads: options.threads,
    };
    let selection = Selection::new(runs, options, progress)?;
    progress(Progress { share: 0.9, doing: "looking for laws without a name, writing the answer" });
    let mut diagnosis = answer(&selection, given_runs, options)?;
    diagnosis.remarks.extend(low_pass::remarks(model, &reference.model));
    Ok(diagnosis)
}

/// Recordings that can be used; without readings of the gyro that pile up at a limit, which show that by themselves.
pub(crate) fn checked<'a>(
    recordings: &'a [Recording],
    model: &PlatformModel,
) -> Result<Cow<'a, [Recording]>, DiagnosisError> {
    for recording in recordings {
        check(recording, model, &NEEDS)?;
    }
    Ok(without_clipped(recordings, model))
}

/// Neither attitude nor momentum can be known: wheels turn, and the gyro is the only sensor.
fn is_blind(recording: &Recording, model: &PlatformModel) -> bool {
    let attitude = recording.vectors.iter().any(|v| !v.direction_b.is_empty())
        || !recording.specific_force_b_m_s2.is_empty();
    let wheels_turn = recording.wheel_torque_command_n_m.value.iter().flatten().any(|u| *u != 0.0);
    !is_clamped(recording, model) && !attitude && recording.wheel_speed_rad_s.is_empty() && wheels_turn
}

fn nothing_of_a_blind_run(training: &[Recording], model: &PlatformModel, name: &str) -> Diagnosis {
    let mut diagnosis = Diagnosis::not_enough_information();
    diagnosis.remarks = training.iter().flat_map(|run| missing_channels(run, model)).collect();
    diagnosis.remarks.push(format!(
        "{name}: the gyro alone, without measured wheel speeds, cannot distinguish a missing effect from the wheels' momentum and the tilt; record the wheel speeds, the accelerometer or a vector sensor"
    ));
    diagnosis
}

/// The model without those low-passes of its inertial sensors that do not delay as stated. Whoever diagnoses and fits the same recordings finds
/// it once, for [`Options::delaying`].
///
/// # Errors
/// As [`diagnose`].
pub fn with_low_passes_that_delay(
    training: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
) -> Result<PlatformModel, DiagnosisError> {
    let available = Available::of(training, model);
    let training = checked(training, model)?;
    let reference = Reference::new(model, prior, options.settings);
    delaying(&reference, &available, &training, options)
}

pub(crate) fn delaying(
    reference: &Reference,
    available: &Available,
    training: &[Recording],
    options: &Options,
) -> Result<PlatformModel, DiagnosisError> {
    if let Some(known) = &options.delaying {
        return Ok(known.clone());
    }
    let stated = &reference.model;
    if training.iter().any(|run| is_blind(run, stated)) {
        return Ok(stated.clone());
    }
    let found = low_pass::without_those_that_do_not_delay(reference, available, training, options.threads)?;
    Ok(found.unwrap_or_else(|| stated.clone()))
}
