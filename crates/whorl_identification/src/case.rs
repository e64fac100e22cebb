//! Recordings and a model, checked against each other: what every question to recordings begins with.

use std::borrow::Cow;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::{Needs, check, longest_cell_s};
use whorl_recording::Recording;

use crate::fitting::low_pass;
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;
use crate::selection::Runs;
use crate::signals::clamped::is_clamped;
use crate::signals::readings::usable;
use crate::{DiagnosisError, Options};

/// What is needed of a recording. Whether it holds enough is a matter of information, not of seconds.
const NEEDS: Needs = Needs { shortest_s: 0.5, free: false, accelerometer: false };

/// Recordings that can be used, and the model with those low-passes that delay.
pub(crate) struct Case<'a> {
    pub training: Cow<'a, [Recording]>,
    pub held_out: Cow<'a, [Recording]>,
    pub reference: Reference,
    pub available: Available,
    /// What was left out of them, in sentences.
    left_out: Vec<String>,
    /// The model as given.
    stated: PlatformModel,
    threads: usize,
}

impl<'a> Case<'a> {
    pub fn new(
        training: &'a [Recording],
        held_out: &'a [Recording],
        model: &PlatformModel,
        prior: &ModelPrior,
        options: &Options,
    ) -> Result<Self, DiagnosisError> {
        let available = Available::of(training, model);
        let (training, mut left_out) = checked(training, model)?;
        let (held_out, of_held_out) = checked(held_out, model)?;
        left_out.extend(of_held_out);
        let given = Reference::new(model, prior, options.settings);
        let reference = Reference { model: delaying(&given, &available, &training, options)?, ..given };
        let reference = with_cells_of(reference, &[&training, &held_out])?;
        Ok(Self {
            training,
            held_out,
            reference,
            available,
            left_out,
            stated: model.clone(),
            threads: options.threads,
        })
    }

    /// What was left out of the recordings, and which low-passes do not delay as the model says.
    pub fn remarks(&self) -> Vec<String> {
        let of_low_passes = low_pass::remarks(&self.stated, &self.reference.model);
        self.left_out.iter().cloned().chain(of_low_passes).collect()
    }

    pub fn runs(&self) -> Runs<'_> {
        Runs {
            training: &self.training,
            held_out: &self.held_out,
            reference: &self.reference,
            available: &self.available,
            threads: self.threads,
            each_reading: false,
        }
    }
}

/// The same model, with as much of these recordings taken in together as all of them allow.
fn with_cells_of(mut reference: Reference, all: &[&[Recording]]) -> Result<Reference, DiagnosisError> {
    let prediction = &mut reference.settings.prediction;
    for recordings in all {
        prediction.cell_s = longest_cell_s(recordings, &reference.model, prediction)?;
    }
    Ok(reference)
}

/// Recordings that can be used, without readings that say nothing, and what was left out.
fn checked<'a>(
    recordings: &'a [Recording],
    model: &PlatformModel,
) -> Result<(Cow<'a, [Recording]>, Vec<String>), DiagnosisError> {
    for recording in recordings {
        check(recording, model, &NEEDS)?;
    }
    Ok(usable(recordings, model))
}

/// Neither attitude nor momentum can be known: wheels turn, and the gyro is the only sensor.
pub(crate) fn is_blind(recording: &Recording, model: &PlatformModel) -> bool {
    let attitude = recording.vectors.iter().any(|v| !v.direction_b.is_empty())
        || !recording.specific_force_b_m_s2.is_empty();
    let wheels_turn = recording.wheel_torque_command_n_m.value.iter().flatten().any(|u| *u != 0.0);
    !is_clamped(recording, model) && !attitude && recording.wheel_speed_rad_s.is_empty() && wheels_turn
}

fn delaying(
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
