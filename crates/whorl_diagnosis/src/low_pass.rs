//! What a stated low-pass of an inertial sensor does: it delays, or it does not.
//!
//! Data sheets and drivers state a bandwidth, or an averaging window. A filter delays what is behind it by its time constant; a window
//! that is stamped in its middle does not delay at all, and by that time a controller's answers, tilt and rates disagree. The samples
//! themselves tell the two apart, and nothing else does: bins of them are as wide as the delay.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_prediction::{Fitted, Settings};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::evidence::problem::Problem;
use crate::parameters::Reference;
use crate::parameters::available::Available;
use crate::refit::Refit;
use crate::search::step::base_point_with;

/// From so much of the beginning of each recording it is told \[s\]: a delay that matters for the rest shows in it.
const LONGEST_S: f64 = 60.0;
/// What is stated is believed unless the samples are likelier by this factor without it (natural logarithm): twenty to one.
const DOUBT_NATS: f64 = 3.0;
/// Values stand when a step promises less than this (natural logarithm).
const STANDS_NATS: f64 = 1.0;

/// The model with those low-passes of its inertial sensors that delay; `None` if all of those stated do.
pub(crate) fn without_those_that_do_not_delay(
    problem: &Problem,
    training: &[Recording],
    threads: usize,
) -> Result<Option<PlatformModel>, DiagnosisError> {
    let (reference, available) = (&problem.reference, &Available::of(&problem.runs));
    let stated = |model: &PlatformModel| delays(model).map(|delay_s| delay_s > 0.0);
    let given = stated(&reference.model);
    if !available.body || given == [false; 2] {
        return Ok(None);
    }
    let parts: Vec<Recording> = training.iter().map(first_part).collect();
    let settings = Settings { threads, fit_stands_nats: STANDS_NATS, ..Settings::default() };
    let fitted = |reference: &Reference, start: &[f64]| -> Result<Option<Fitted>, DiagnosisError> {
        DiagnosisError::possible(Refit::own(reference, available).likeliest(
            &parts,
            &[start.to_vec()],
            &settings,
        ))
    };
    // Near the end already, if the motion can be smoothed.
    let refit = Refit::own(reference, available);
    let smoothed = DiagnosisError::possible(base_point_with(&mut problem.clone(), &mut None))?;
    let start = smoothed.map_or_else(|| vec![0.0; refit.columns.len()], |point| refit.units_of(&point));
    let Some(as_stated) = fitted(reference, &start)? else { return Ok(None) };
    let (mut best, mut most) = (None, as_stated.log_posterior + DOUBT_NATS);
    for kept in [[false, false], [true, false], [false, true]] {
        // Each that is stated, and all of them.
        let changes = kept.iter().zip(given).any(|(kept, given)| given && !kept);
        let is_new = kept.iter().zip(given).all(|(kept, given)| given || !kept);
        if !changes || !is_new {
            continue;
        }
        let mut other = reference.clone();
        let errors = inertial_errors(&mut other.model);
        errors
            .into_iter()
            .zip(kept)
            .filter(|(_, kept)| !kept)
            .for_each(|(errors, _)| errors.time_constant_s = 0.0);
        let Some(found) = fitted(&other, &as_stated.at)? else { continue };
        if found.log_posterior > most {
            (best, most) = (Some(other.model), found.log_posterior);
        }
    }
    Ok(best)
}

/// What that means for whoever stated it.
pub(crate) fn remarks(stated: &PlatformModel, shown: &PlatformModel) -> Vec<String> {
    let names = ["gyro", "accelerometer"];
    let of_sensors = delays(stated).into_iter().zip(delays(shown)).zip(names);
    let wrong = of_sensors.filter(|((stated_s, shown_s), _)| stated_s != shown_s);
    wrong
        .map(|((stated_s, _), name)| {
            format!(
                "the {name} does not delay by its time constant of {} ms as the model says: its samples are likelier without, as where an averaging window is stamped in its middle, and so they are taken",
                stated_s * 1e3
            )
        })
        .collect()
}

fn delays(model: &PlatformModel) -> [f64; 2] {
    [model.sensors.gyro.errors.time_constant_s, model.sensors.accelerometer.errors.time_constant_s]
}

fn inertial_errors(model: &mut PlatformModel) -> [&mut TriaxialErrors; 2] {
    [&mut model.sensors.gyro.errors, &mut model.sensors.accelerometer.errors]
}

/// The readings of the beginning; commands are read only as far as these go.
fn first_part(recording: &Recording) -> Recording {
    let mut part = recording.clone();
    let begin_s = part.gyro_b_rad_s.time_s.first().copied().unwrap_or(0.0);
    let keep = |times: &[f64]| times.partition_point(|t| *t < begin_s + LONGEST_S);
    macro_rules! cut {
        ($($series:expr),*) => {$(
            let count = keep(&$series.time_s);
            $series.time_s.truncate(count);
            $series.value.truncate(count);
        )*};
    }
    cut!(part.gyro_b_rad_s, part.specific_force_b_m_s2, part.wheel_speed_rad_s);
    for vector in &mut part.vectors {
        cut!(vector.direction_b);
    }
    part
}
