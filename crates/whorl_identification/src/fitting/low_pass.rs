//! Whether a stated low-pass of an inertial sensor delays its readings.
//!
//! Data sheets and drivers state a bandwidth, or an averaging window. A filter delays its output by its time constant; an average over
//! a window that is stamped in its middle has no delay. If the model assumes the wrong one, a controller's responses, tilt and rates
//! disagree by that time. A window stamped at its end delays by
//! half its length; so a time constant that does not delay is half of a window, or nothing.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_prediction::{Rival, Settings};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::refit::Refit;
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;

/// Length of the start of each recording that is used \[s\]: a delay that matters for the whole recording shows in it.
const LONGEST_S: f64 = 60.0;

/// The model with those low-passes of its inertial sensors that delay; `None` if all of those stated do.
pub(crate) fn without_those_that_do_not_delay(
    reference: &Reference,
    available: &Available,
    training: &[Recording],
    threads: usize,
) -> Result<Option<PlatformModel>, DiagnosisError> {
    let stated = |model: &PlatformModel| delays(model).map(|delay_s| delay_s > 0.0);
    let given = stated(&reference.model);
    if !available.body || given == [false; 2] {
        return Ok(None);
    }
    let parts: Vec<Recording> = training.iter().map(first_part).collect();
    let settings = Settings {
        threads,
        fit_stands_nats: reference.settings.unfinished_nats,
        // Its time is that of a few readings.
        cell_s: 0.0,
        ..reference.settings.prediction
    };
    let fitted = |reference: &Reference, start: &[f64], rival: Rival<'_>| {
        let refit = Refit::own(reference, available);
        DiagnosisError::possible(refit.likeliest(&parts, &[start.to_vec()], rival, &settings))
    };
    let start = vec![0.0; Refit::own(reference, available).columns.len()];
    let Some(as_stated) = fitted(reference, &start, Rival::NONE)? else { return Ok(None) };
    // The likeliest so far: the model if it is another one, values, and how likely they are.
    let mut best: (Option<Reference>, Vec<f64>, f64) =
        (None, as_stated.at.clone(), as_stated.log_posterior + reference.settings.doubt_nats);
    let try_other = |other: Reference, best: &mut (Option<Reference>, Vec<f64>, f64), from: &[f64]| {
        let rival = Rival { followed: &as_stated.followed, log_posterior_needed: best.2 };
        if let Some(found) = fitted(&other, from, rival)?.filter(|found| found.log_posterior > best.2) {
            *best = (Some(other), found.at, found.log_posterior);
        }
        Ok::<(), DiagnosisError>(())
    };
    for kept in [[false, false], [true, false], [false, true]] {
        // Each that is stated, and all of them.
        let changes = kept.iter().zip(given).any(|(kept, given)| given && !kept);
        let is_new = kept.iter().zip(given).all(|(kept, given)| given || !kept);
        if !changes || !is_new {
            continue;
        }
        let mut other = reference.clone();
        for (errors, _) in inertial_errors(&mut other.model).into_iter().zip(kept).filter(|(_, kept)| !kept) {
            errors.averaging_window_s = 2.0 * errors.time_constant_s;
            errors.time_constant_s = 0.0;
        }
        try_other(other, &mut best, &as_stated.at)?;
    }
    if let (Some(mut other), from, _) = best.clone() {
        for (errors, stated_s) in inertial_errors(&mut other.model).into_iter().zip(windows(&reference.model))
        {
            errors.averaging_window_s = stated_s;
        }
        best.2 += reference.settings.doubt_nats;
        try_other(other, &mut best, &from)?;
    }
    Ok(best.0.map(|best| best.model))
}

/// What that means for whoever stated it.
pub(crate) fn remarks(stated: &PlatformModel, shown: &PlatformModel) -> Vec<String> {
    let names = ["gyro", "accelerometer"];
    let of_sensors = delays(stated).into_iter().zip(delays(shown)).zip(windows(shown)).zip(names);
    let wrong = of_sensors.filter(|(((stated_s, shown_s), _), _)| stated_s != shown_s);
    wrong
        .map(|(((stated_s, _), window_s), name)| {
            let instead = if window_s > 0.0 {
                format!("as means over a window of {} ms that is stamped in its middle (averaging_window_s)", window_s * 1e3)
            } else {
                "without any".to_owned()
            };
            format!(
                "the {name} does not delay by its time constant of {} ms as the model says: its samples are likelier {instead}, and so they are taken",
                stated_s * 1e3
            )
        })
        .collect()
}

fn windows(model: &PlatformModel) -> [f64; 2] {
    [model.sensors.gyro.errors.averaging_window_s, model.sensors.accelerometer.errors.averaging_window_s]
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
