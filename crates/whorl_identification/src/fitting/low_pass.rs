//! Whether a stated low-pass of an inertial sensor delays its readings.
//! A filter delays its output by its time constant, an average that is stamped in the middle of its window does not; one stamped at the end
//! delays by half its length. So a time constant that does not delay is half of a window, or nothing.

use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::Need;
use whorl_dynamics::platform::TriaxialErrors;
use whorl_math::normal_equations::Estimate;
use whorl_prediction::{Rival, Settings, hints, longest_cell_s};
use whorl_recording::{Recording, stretch};

use crate::DiagnosisError;
use crate::fitting::refit::{Refit, about};
use crate::parameter_space::Reference;
use crate::parameter_space::available::Available;

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
    let prediction = Settings { threads, ..reference.settings.prediction };
    let fit_stands_nats = reference.settings.unfinished_nats;
    let cell_s = longest_cell_s(&parts, &reference.model, &prediction)?;
    let by_cells = Settings { fit_stands_nats, cell_s, ..prediction };
    let own = Refit::own(reference, available);
    let start = vec![0.0; own.columns.len()];
    let found = own.likeliest(&parts, &[start], Rival::NONE, &by_cells);
    let Some(as_stated) = DiagnosisError::possible(found)? else { return Ok(()) };
    // A filter's time is that of a few readings.
    let by_readings = Settings { cell_s: 0.0, ..prediction };
    // How likely a model with other errors is where its values are likeliest, by a parabola about those of the stated ones, whose noise it has.
    let log_with = |errors: [TriaxialErrors; 2]| -> Result<f64, DiagnosisError> {
        let mut tried = reference.clone();
        [tried.model.sensors.gyro.errors, tried.model.sensors.accelerometer.errors] = errors;
        let refit = Refit::own(&tried, available);
        let (parameters, model_at) = (refit.parameters(), |units: &[f64]| refit.model_at(units));
        let (at, followed) = (&as_stated.at, &as_stated.followed);
        let found = hints(&parts, &parameters, &model_at, at, followed, &[], &by_readings)?;
        let normal = about(&found, at, &parameters);
        let all: Vec<usize> = (0..at.len()).collect();
        let top = Estimate::new(&normal, &all, |i| parameters[i].stddev.powi(2));
        let log: f64 = found.iter().map(|of_run| of_run.log_likelihood).sum();
        Ok(log + top.map_or(f64::NEG_INFINITY, |top| 0.5 * top.drop))
    };
    let doubt = reference.settings.doubt_nats;
    let mut best = (log_with(given)? + doubt, given);
    // Each that is stated, and all of them, as means over a window;
    let both = vec![[true, true], [false, true], [true, false]];
    for changed in if is_stated == [true; 2] { both } else { vec![is_stated] } {
        let mut errors = given;
        for (errors, _) in errors.iter_mut().zip(changed).filter(|(_, changed)| *changed) {
            errors.averaging_window_s = 2.0 * errors.time_constant_s;
            errors.time_constant_s = 0.0;
        }
        let log = log_with(errors)?;
        best = if log > best.0 { (log, errors) } else { best };
    }
    if best.1 == given {
        return Ok(());
    }
    // and the likeliest of these over no window but the stated one.
    let mut without = best.1;
    without.iter_mut().zip(given).for_each(|(own, given)| own.averaging_window_s = given.averaging_window_s);
    let is_better = log_with(without)? > best.0 + doubt;
    let sensors = &mut reference.model.sensors;
    [sensors.gyro.errors, sensors.accelerometer.errors] = if is_better { without } else { best.1 };
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
