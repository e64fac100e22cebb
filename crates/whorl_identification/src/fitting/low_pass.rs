//! Whether a stated low-pass of an inertial sensor delays its readings.
//! A filter delays its output by its time constant, an average that is stamped in the middle of its window does not; one stamped at the end
//! delays by half its length. So a time constant that does not delay is half of a window, or nothing.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Need;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_prediction::{Fitted, Rival, Settings};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::fitting::refit::Refit;
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;
use crate::stretch::stretch;

/// Length of the start of each recording that is used \[s\]: a delay that matters for the whole recording shows in it.
const LONGEST_S: f64 = 60.0;

/// Leaves those low-passes of its inertial sensors in the reference's model that delay.
pub(crate) fn take_those_that_delay(
    reference: &mut Reference,
    available: &Available,
    training: &[Recording],
    threads: usize,
) -> Result<(), DiagnosisError> {
    let given = inertial_errors(&reference.model);
    let is_stated = given.map(|errors| errors.time_constant_s > 0.0);
    if !available.has(Need::FreeBody) || is_stated == [false; 2] {
        return Ok(());
    }
    let end_s = |run: &Recording| run.gyro_b_rad_s.time_s.first().unwrap_or(&0.0) + LONGEST_S;
    let beginning = |run| stretch(run, f64::NEG_INFINITY, end_s(run));
    let parts: Vec<Recording> = training.iter().map(beginning).collect();
    let doubt = reference.settings.doubt_nats;
    let settings = Settings {
        threads,
        fit_stands_nats: reference.settings.unfinished_nats,
        // Its time is that of a few readings.
        cell_s: 0.0,
        ..reference.settings.prediction
    };
    // A model with these errors, its values and how likely they are.
    let fitted = |errors: [TriaxialErrors; 2], start: &[f64], rival: Rival<'_>| {
        let mut tried = reference.clone();
        [tried.model.sensors.gyro.errors, tried.model.sensors.accelerometer.errors] = errors;
        let found = Refit::own(&tried, available).likeliest(&parts, &[start.to_vec()], rival, &settings);
        Ok::<_, DiagnosisError>(DiagnosisError::possible(found)?.map(|found| (tried.model, found)))
    };
    let start = vec![0.0; Refit::own(reference, available).columns.len()];
    let Some((_, as_stated)) = fitted(given, &start, Rival::NONE)? else { return Ok(()) };
    let mut best: Option<(PlatformModel, Fitted)> = None;
    let likelier = |errors: [TriaxialErrors; 2], start: &[f64], than: f64| {
        let rival = Rival { followed: &as_stated.followed, log_posterior_needed: than };
        Ok::<_, DiagnosisError>(fitted(errors, start, rival)?.filter(|(_, found)| found.log_posterior > than))
    };
    // Each that is stated, and all of them, as means over a window;
    let both = vec![[true, true], [false, true], [true, false]];
    for changed in if is_stated == [true; 2] { both } else { vec![is_stated] } {
        let mut errors = given;
        for (errors, _) in errors.iter_mut().zip(changed).filter(|(_, changed)| *changed) {
            errors.averaging_window_s = 2.0 * errors.time_constant_s;
            errors.time_constant_s = 0.0;
        }
        let than = best.as_ref().map_or(as_stated.log_posterior + doubt, |(_, best)| best.log_posterior);
        best = likelier(errors, &as_stated.at, than)?.or(best);
    }
    // and the likeliest of these over no window but the stated one.
    let Some((model, found)) = best else { return Ok(()) };
    let mut errors = inertial_errors(&model);
    errors.iter_mut().zip(given).for_each(|(own, given)| own.averaging_window_s = given.averaging_window_s);
    let without = likelier(errors, &found.at, found.log_posterior + doubt)?;
    reference.model = without.map_or(model, |(without, _)| without);
    Ok(())
}

/// What that means for whoever stated it.
pub(crate) fn remarks(stated: &PlatformModel, shown: &PlatformModel) -> Vec<String> {
    let all = inertial_errors(stated).into_iter().zip(inertial_errors(shown)).zip(["gyro", "accelerometer"]);
    let remark = |((stated, shown), name): ((TriaxialErrors, TriaxialErrors), &str)| {
        let ms = shown.averaging_window_s * 1e3;
        let instead = if ms > 0.0 {
            format!("as means over a window of {ms} ms that is stamped in its middle (averaging_window_s)")
        } else {
            "without any".to_owned()
        };
        (stated.time_constant_s != shown.time_constant_s).then(|| format!(
            "the {name} does not delay by its time constant of {} ms as the model says: its samples are likelier {instead}, and so they are taken",
            stated.time_constant_s * 1e3
        ))
    };
    all.filter_map(remark).collect()
}

fn inertial_errors(model: &PlatformModel) -> [TriaxialErrors; 2] {
    [model.sensors.gyro.errors, model.sensors.accelerometer.errors]
}
