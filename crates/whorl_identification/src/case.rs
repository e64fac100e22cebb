//! Recordings and a model, checked against each other: what every question to recordings begins with.

use std::borrow::Cow;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_prediction::longest_cell_s;
use whorl_recording::{Needs, Recording, check, usable_readings};

use crate::fitting::low_pass;
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;
use crate::selection::Runs;
use crate::{DiagnosisError, Options};

/// What is needed of a recording. Whether it holds enough is a matter of information, not of seconds.
const NEEDS: Needs = Needs { shortest_s: 0.5, free: false, accelerometer: false };

/// Recordings that can be used, and the model with those low-passes that delay.
pub(crate) struct Case {
    pub training: Vec<Recording>,
    pub held_out: Vec<Recording>,
    pub reference: Reference,
    pub available: Available,
    /// What was left out of the recordings, and which low-passes do not delay as the model says, in sentences.
    pub remarks: Vec<String>,
    threads: usize,
}

impl Case {
    pub fn new(
        training: &[Recording],
        held_out: &[Recording],
        model: &PlatformModel,
        prior: &ModelPrior,
        options: &Options,
    ) -> Result<Self, DiagnosisError> {
        let available = Available::of(training, model);
        training.iter().chain(held_out).try_for_each(|recording| check(recording, model, &NEEDS))?;
        let [(training, left_out), (held_out, of_held_out)] =
            [training, held_out].map(|runs| usable(runs, model));
        let (prior, settings) = (prior.clone(), options.settings);
        let mut reference = Reference { model: model.clone(), prior, settings };
        if let Some(known) = &options.delaying {
            reference.model = known.clone();
        } else if !training.iter().any(|run| is_blind(run, model)) {
            low_pass::take_those_that_delay(&mut reference, &available, &training, options.threads)?;
        }
        // As much is taken in together as all recordings allow.
        for recordings in [&training, &held_out] {
            let prediction = &mut reference.settings.prediction;
            prediction.cell_s = longest_cell_s(recordings, &reference.model, prediction)?;
        }
        let remarks = [left_out, of_held_out, low_pass::remarks(model, &reference.model)].concat();
        Ok(Self { training, held_out, reference, available, remarks, threads: options.threads })
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

/// Neither attitude nor momentum can be known: wheels turn, and the gyro is the only sensor.
pub(crate) fn is_blind(recording: &Recording, model: &PlatformModel) -> bool {
    let attitude = recording.vectors.iter().any(|v| !v.direction_b.is_empty())
        || !recording.specific_force_b_m_s2.is_empty();
    let wheels_turn = recording.wheel_torque_command_n_m.value.iter().flatten().any(|u| *u != 0.0);
    !recording.is_clamped(model) && !attitude && recording.wheel_speed_rad_s.is_empty() && wheels_turn
}

/// Recordings without readings that say nothing, and what was left out, in sentences.
pub(crate) fn usable(recordings: &[Recording], model: &PlatformModel) -> (Vec<Recording>, Vec<String>) {
    let (kept, remarks): (Vec<_>, Vec<_>) = recordings.iter().map(|run| usable_readings(run, model)).unzip();
    (kept.into_iter().map(Cow::into_owned).collect(), remarks.concat())
}
