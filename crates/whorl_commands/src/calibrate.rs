//! Answers of `calibrate` as data.

use anyhow::bail;
use serde_json::{Value, json};
use whorl_calibration::{CalibrationSettings, ImuCalibration, Misfit, PerAxis, SensorCalibration};
use whorl_explain::changes::{Change, of_calibration};
use whorl_math::{NoiseDensities, rad_from_deg, three_digits};
use whorl_params::Value as Parameter;

use crate::identify::findings_as_json;

/// Version of the JSON output.
const SCHEMA: u32 = 1;

/// Gravity anywhere on the ground [m/s^2].
const GRAVITY_M_S2: std::ops::RangeInclusive<f64> = 9.7..=9.9;

/// Settings from degrees; `known_turn_deg`: turns about the vertical were multiples of it; `gravity_m_s2`: local gravity, if known.
///
/// # Errors
/// An angle that is not positive, or a gravity that is nowhere on Earth, by its name.
pub fn settings(
    known_turn_deg: Option<f64>,
    turn_error_deg: f64,
    level_error_deg: f64,
    gravity_m_s2: Option<f64>,
) -> anyhow::Result<CalibrationSettings> {
    if let Some(gravity) = gravity_m_s2.filter(|gravity| !GRAVITY_M_S2.contains(gravity)) {
        bail!("--gravity is {gravity}; allowed: {} to {} m/s^2", GRAVITY_M_S2.start(), GRAVITY_M_S2.end());
    }
    for (value, what) in [
        (turn_error_deg, "--turn-error-deg"),
        (level_error_deg, "--level-error-deg"),
        (known_turn_deg.unwrap_or(1.0), "--known-turn-deg"),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            bail!("{what} is {value}; allowed: a positive number of degrees");
        }
    }
    Ok(CalibrationSettings {
        level_stddev_rad: rad_from_deg(level_error_deg),
        known_turn_rad: known_turn_deg.map(rad_from_deg),
        turn_stddev_rad: rad_from_deg(turn_error_deg),
        gravity_m_s2,
    })
}

/// Everything; what was not determined is null.
#[must_use]
pub fn as_json(platform: &str, found: &ImuCalibration) -> Value {
    json!({
        "schema": SCHEMA,
        "platform": platform,
        "still_stretches": found.still.len(),
        "rate_hz": found.rate_hz,
        "usable": !found.findings.iter().any(|finding| finding.fatal),
        "gyro": sensor(&found.gyro, "rad/s"),
        "accelerometer": sensor(&found.accelerometer, "m/s^2"),
        "findings": findings_as_json(&found.findings),
    })
}

fn sensor(of: &SensorCalibration, unit: &str) -> Value {
    json!({
        "bias": per_axis(&of.bias, unit),
        "scale": per_axis(&of.scale, "1"),
        "misalignment": per_axis(&of.misalignment_rad, "rad"),
        "skew": per_axis(&of.skew_rad, "rad"),
        "temperature_slope": per_axis(&of.temperature_slope, &format!("{unit}/K")),
        "noise_stddev": {"unit": unit, "value": of.noise_stddev.as_slice(), "stddev": of.noise_stddev_stddev.as_slice()},
        "noise_density": per_axis(&white(of), &format!("{unit}/sqrt(Hz)")),
        "bias_walk": per_axis(&walk(of), &format!("{unit}/sqrt(s)")),
        "bias_instability": per_axis(&instability(of), unit),
        "misfit": of.misfit.map(|misfit: Misfit| json!({
            "ratio": misfit.ratio(), "degrees_of_freedom": misfit.dof, "fits": misfit.fits(),
        })),
    })
}

fn of_noise(sensor: &SensorCalibration, pick: impl Fn(&NoiseDensities) -> Option<[f64; 2]>) -> PerAxis {
    let mut all = PerAxis { value: [0.0; 3].into(), stddev: [f64::INFINITY; 3].into() };
    for (axis, found) in sensor.noise.iter().enumerate() {
        if let Some([value, stddev]) = found.as_ref().and_then(&pick) {
            (all.value[axis], all.stddev[axis]) = (value, stddev);
        }
    }
    all
}

/// White noise density per axis.
#[must_use]
pub fn white(sensor: &SensorCalibration) -> PerAxis {
    of_noise(sensor, |fit| Some([fit.white, fit.white_stddev]))
}

/// Random walk of the bias per axis, where it rises out of the white noise.
#[must_use]
pub fn walk(sensor: &SensorCalibration) -> PerAxis {
    of_noise(sensor, |fit| fit.walk_seen.then_some([fit.walk, fit.walk_stddev]))
}

/// Bias instability per axis, where averaging longer does not help any more: the lowest Allan deviation.
#[must_use]
pub fn instability(sensor: &SensorCalibration) -> PerAxis {
    of_noise(sensor, |fit| fit.floor_seen.then_some([fit.floor, fit.floor_stddev]))
}

/// What a calibration changes in the platform's file: the errors, and in `model_prior` how well they are known.
#[must_use]
pub fn changes(found: &ImuCalibration) -> Vec<Change> {
    let mut all = of_calibration(found);
    for (name, suffix, sensor) in
        [("gyro", "rad_s", &found.gyro), ("accelerometer", "m_s2", &found.accelerometer)]
    {
        let sample = PerAxis { value: sensor.noise_stddev, stddev: sensor.noise_stddev_stddev };
        let quantities = [
            (format!("bias_{suffix}"), sensor.bias),
            ("scale".to_owned(), sensor.scale),
            ("misalignment_rad".to_owned(), sensor.misalignment_rad),
            ("skew_rad".to_owned(), sensor.skew_rad),
            (format!("noise_stddev_{suffix}"), sample),
            (format!("bias_walk_{suffix}_sqrt_s"), walk(sensor)),
        ];
        for (key, quantity) in quantities {
            // Beside what was written, and nowhere else.
            let is_written = all.iter().any(|change| change.key == format!("model.sensors.{name}.{key}"));
            if is_written && quantity.determined() == [true; 3] {
                let rounded = |x: &f64| three_digits(*x).parse().unwrap_or(*x);
                let value = Parameter::DoubleArray(quantity.stddev.iter().map(rounded).collect());
                let comment = "standard deviation, calibrated".to_owned();
                all.push(Change { key: format!("model_prior.sensors.{name}.{key}"), value, comment });
            }
        }
    }
    all
}

fn per_axis(of: &PerAxis, unit: &str) -> Value {
    let known = |axis: usize, value: f64| {
        of.stddev.as_slice().get(axis).is_some_and(|s| s.is_finite()).then_some(value)
    };
    let all = |values: &[f64]| -> Vec<Option<f64>> {
        values.iter().enumerate().map(|(axis, value)| known(axis, *value)).collect()
    };
    json!({"unit": unit, "value": all(of.value.as_slice()), "stddev": all(of.stddev.as_slice())})
}
