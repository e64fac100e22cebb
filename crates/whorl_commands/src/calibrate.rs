//! Answers of `calibrate` as data.

use anyhow::bail;
use serde_json::{Value, json};
use whorl_identification::calibration::{CalibrationSettings, ImuCalibration, PerAxis, SensorCalibration};
use whorl_math::rad_from_deg;

use crate::identify::findings_as_json;

/// Version of the JSON output.
const SCHEMA: u32 = 1;

/// Settings from degrees; `known_turn_deg`: turns about the vertical were multiples of it.
///
/// # Errors
/// An angle that is not positive, by its name.
pub fn settings(
    known_turn_deg: Option<f64>,
    turn_error_deg: f64,
    level_error_deg: f64,
) -> anyhow::Result<CalibrationSettings> {
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
        "temperature_slope": per_axis(&of.temperature_slope, &format!("{unit}/K")),
        "noise_stddev": {"unit": unit, "value": of.noise_stddev.as_slice()},
    })
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
