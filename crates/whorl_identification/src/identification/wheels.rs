//! Wheels whose measured speeds turn the body the wrong way, or by another share than the model's.
//!
//! The wheels' strengths are fitted alone, with the wheels driven along their measured speeds: commands may have the sign of the model
//! where speeds do not. Whatever else pushes the platform goes into the strengths too. What that fit finds is therefore a suspicion, and
//! counts only where it makes the readings likelier than everything that was fitted.

use std::f64::consts::{PI, TAU};

use whorl_dynamics::PlatformModel;
use whorl_math::three_digits;
use whorl_prediction::{Parameter, PredictionError, Settings, fit};
use whorl_recording::{Recording, Series};

use whorl_recording::Finding;

/// Freedom of a wheel's strength over the model's, one standard deviation: the sign may be wrong, and a unit.
const LOOSE_STRENGTH: f64 = 2.0;
/// Least strength that a model is made with: a wheel has some inertia.
const LEAST_STRENGTH: f64 = 1e-3;
/// Strengths of wheels whose speeds were recorded in other units: in revolutions per minute, and per second.
const OF_OTHER_UNITS: [f64; 2] = [PI / 30.0, TAU];
/// Strengths that are known worse than this say nothing.
const KNOWN: f64 = 0.3;
/// Shares that are as close to one as this are the platform's inertia as well as the wheel's.
const FAR_OFF: f64 = 0.3;
/// By how much likelier another strength must make the readings [natural logarithm]: a hundred thousand to one, as a wheel is accused.
const NEEDED_NATS: f64 = 11.5;

/// Wheels that the readings accuse; `log_fitted`: how likely the readings are with what was fitted [natural logarithm].
///
/// # Errors
/// See [`PredictionError`].
pub(super) fn check(
    recordings: &[Recording],
    model: &PlatformModel,
    log_fitted: f64,
    settings: &Settings,
) -> Result<Vec<Finding>, PredictionError> {
    let mut findings = Vec::new();
    for (j, share, stddev) in suspicions(recordings, model, settings) {
        // A sign is a sign, whatever else is in the number.
        let supposed = if share < 0.0 { -1.0 } else { share };
        let log = log_of_share(recordings, model, j, supposed, settings)?;
        if let Some(wheel) = model.wheels().get(j).filter(|_| log - log_fitted > NEEDED_NATS) {
            findings.push(said(&wheel.name, share, stddev));
        }
    }
    Ok(findings)
}

/// Wheels whose strength comes out far from the model's, as its position, share of the model's strength and standard deviation. Where one
/// has the wrong sign, or another unit, no start close to the model leads there, so each is tried.
fn suspicions(
    recordings: &[Recording],
    model: &PlatformModel,
    settings: &Settings,
) -> Vec<(usize, f64, f64)> {
    let driven: Vec<Recording> = recordings
        .iter()
        .filter(|run| !run.wheel_speed_rad_s.is_empty())
        .map(|run| Recording { wheel_torque_command_n_m: Series::default(), ..run.clone() })
        .collect();
    let wheels = model.wheels().len();
    if driven.is_empty() || wheels == 0 {
        return Vec::new();
    }
    // Three deviations hold all that is tried.
    let known = Parameter { stddev: 1.0, range: (-3.0, 3.0) };
    let given = vec![0.0; wheels];
    let model_at = |units: &[f64]| {
        let shares = units.iter().map(|units| 1.0 + LOOSE_STRENGTH * units);
        Some(with_strengths(model, shares))
    };
    let with = |wheel: Option<usize>, share: f64| {
        let of = |j: usize| if wheel.is_none_or(|wheel| wheel == j) { share } else { 1.0 };
        (0..wheels).map(|j| (of(j) - 1.0) / LOOSE_STRENGTH).collect::<Vec<f64>>()
    };
    let single = (0..wheels).map(Some);
    let turned = single.clone().map(|wheel| with(wheel, -1.0));
    let in_units = single.chain([None]).flat_map(|wheel| OF_OTHER_UNITS.map(|share| with(wheel, share)));
    let starts: Vec<Vec<f64>> = std::iter::once(given).chain(turned).chain(in_units).collect();
    let Ok(found) = fit(&driven, &vec![known; wheels], &model_at, &starts, settings) else {
        return Vec::new();
    };
    let all = found.at.iter().enumerate().map(|(j, units)| {
        (j, 1.0 + LOOSE_STRENGTH * units, LOOSE_STRENGTH * found.covariance[(j, j)].sqrt())
    });
    all.filter(|(_, share, stddev)| is_far(*share, *stddev)).collect()
}

fn is_far(share: f64, stddev: f64) -> bool {
    let known = stddev <= KNOWN;
    known && (share < -3.0 * stddev || (share - 1.0).abs() > (5.0 * stddev).max(FAR_OFF))
}

/// How likely the readings are if a wheel has this share of the strength that its measured speeds and the model say [natural logarithm]: as
/// another wheel, on which commands and speeds agree, or with another tachometer, on which they do not. The likelier counts.
fn log_of_share(
    recordings: &[Recording],
    model: &PlatformModel,
    wheel: usize,
    share: f64,
    settings: &Settings,
) -> Result<f64, PredictionError> {
    let log = |recordings: &[Recording], model: &PlatformModel| -> Result<f64, PredictionError> {
        Ok(fit(recordings, &[], &|_| Some(model.clone()), &[Vec::new()], settings)?.log_posterior)
    };
    let other =
        with_strengths(model, (0..model.wheels().len()).map(|j| if j == wheel { share } else { 1.0 }));
    let of_wheel = log(recordings, &other)?;
    let mut scaled = recordings.to_vec();
    let speeds = scaled.iter_mut().flat_map(|run| &mut run.wheel_speed_rad_s.value);
    speeds.filter_map(|speeds| speeds.get_mut(wheel)).for_each(|speed| *speed *= share);
    // Densities of the readings as they were recorded; without commands speeds are none, they drive the wheel.
    let read = recordings.iter().filter(|run| !run.wheel_torque_command_n_m.is_empty());
    let numbers: usize = read.map(|run| run.wheel_speed_rad_s.len()).sum();
    let of_speeds = log(&scaled, model)? + numbers as f64 * share.abs().max(LEAST_STRENGTH).ln();
    Ok(of_wheel.max(of_speeds))
}

fn said(name: &str, share: f64, stddev: f64) -> Finding {
    let (of_model, uncertain) = (three_digits(share), three_digits(stddev));
    Finding::fatal(if share < 0.0 {
        format!(
            "{name} turns the body the wrong way: its strength comes out as {of_model} +- {uncertain} of the model's. The sign of its measured speed or of its spin axis in the model is wrong; nothing else can be trusted until that is corrected."
        )
    } else {
        format!(
            "{name} has {of_model} +- {uncertain} of the strength that the model gives it: its spin inertia, the unit of its speed, or the platform's inertia is far off."
        )
    })
}

fn with_strengths(model: &PlatformModel, shares: impl Iterator<Item = f64>) -> PlatformModel {
    let mut model = model.clone();
    for (wheel, share) in model.wheels_mut().iter_mut().zip(shares) {
        wheel.spin_inertia_kg_m2 *= share.abs().max(LEAST_STRENGTH);
        if share < 0.0 {
            wheel.spin_axis_b = -wheel.spin_axis_b;
        }
    }
    model
}
