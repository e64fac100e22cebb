//! Whether a stated low-pass of an inertial sensor delays its readings.
//!
//! A filter delays its output by its time constant, an average that is stamped in the middle of its window does not; one stamped at the end
//! delays by half its length. So a time constant that does not delay is half of a window, or nothing.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Need;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_prediction::{Rival, Settings};
use whorl_recording::{Recording, Series};

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
    let given = delays(&reference.model).map(|delay_s| delay_s > 0.0);
    if !available.has(Need::FreeBody) || given == [false; 2] {
        return Ok(None);
    }
    let parts: Vec<Recording> = training.iter().map(first_part).collect();
    let doubt = reference.settings.doubt_nats;
    let settings = Settings {
        threads,
        fit_stands_nats: reference.settings.unfinished_nats,
        // Its time is that of a few readings.
        cell_s: 0.0,
        ..reference.settings.prediction
    };
    let fitted = |model: &PlatformModel, start: &[f64], rival: Rival<'_>| {
        let reference = Reference { model: model.clone(), ..reference.clone() };
        let refit = Refit::own(&reference, available);
        DiagnosisError::possible(refit.likeliest(&parts, &[start.to_vec()], rival, &settings))
    };
    let start = vec![0.0; Refit::own(reference, available).columns.len()];
    let Some(as_stated) = fitted(&reference.model, &start, Rival::NONE)? else { return Ok(None) };
    // A model with its values and how likely they are, if that is more than is needed.
    let tried = |model: PlatformModel, from: &[f64], log_posterior_needed: f64| {
        let found = fitted(&model, from, Rival { followed: &as_stated.followed, log_posterior_needed })?;
        let found = found.filter(|found| found.log_posterior > log_posterior_needed);
        Ok::<_, DiagnosisError>(found.map(|found| (model, found.at, found.log_posterior)))
    };
    let mut best = None;
    // Each that is stated, and all of them, as means over a window;
    for changed in [[true, true], [false, true], [true, false]] {
        if changed.iter().zip(given).any(|(changed, given)| *changed && !given) {
            continue;
        }
        let mut model = reference.model.clone();
        for (errors, _) in inertial_errors(&mut model).into_iter().zip(changed).filter(|(_, is)| *is) {
            errors.averaging_window_s = 2.0 * errors.time_constant_s;
            errors.time_constant_s = 0.0;
        }
        let needed = best.as_ref().map_or(as_stated.log_posterior + doubt, |(_, _, log)| *log);
        best = tried(model, &as_stated.at, needed)?.or(best);
    }
    // and the likeliest of these over no window but the stated one.
    if let Some((mut model, from, log)) = best.clone() {
        for (errors, stated_s) in inertial_errors(&mut model).into_iter().zip(windows(&reference.model)) {
            errors.averaging_window_s = stated_s;
        }
        best = tried(model, &from, log + doubt)?.or(best);
    }
    Ok(best.map(|(model, ..)| model))
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
    fn cut<T>(series: &mut Series<T>, end_s: f64) {
        let count = series.time_s.partition_point(|t| *t < end_s);
        series.time_s.truncate(count);
        series.value.truncate(count);
    }
    let mut part = recording.clone();
    let end_s = part.gyro_b_rad_s.time_s.first().copied().unwrap_or(0.0) + LONGEST_S;
    cut(&mut part.gyro_b_rad_s, end_s);
    cut(&mut part.specific_force_b_m_s2, end_s);
    cut(&mut part.wheel_speed_rad_s, end_s);
    part.vectors.iter_mut().for_each(|vector| cut(&mut vector.direction_b, end_s));
    part
}
