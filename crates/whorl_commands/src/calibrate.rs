//! Answers of `calibrate` as data.

use anyhow::bail;
use nalgebra::Vector3;
use serde_json::{Value, json};
use whorl_calibration::{CalibrationSettings, ImuCalibration, SensorCalibration};
use whorl_math::rad_from_deg;

use crate::identify::findings_as_json;

/// Version of the JSON output.
const SCHEMA: u32 = 2;

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
    let sensors = found.sensors().map(|(name, unit, of)| (name.to_owned(), sensor(of, unit)));
    let mut value = json!({
        "schema": SCHEMA,
        "platform": platform,
        "still_stretches": found.still_stretches,
        "rate_hz": found.rate_hz,
        "usable": !found.findings.iter().any(|finding| finding.fatal),
        "findings": findings_as_json(&found.findings),
    });
    value.as_object_mut().into_iter().for_each(|object| object.extend(sensors.clone()));
    value
}

fn sensor(of: &SensorCalibration, unit: &str) -> Value {
    let rows = of.quantities(unit).map(|quantity| {
        let known = |values: &Vector3<f64>| -> Vec<Option<f64>> {
            let all = values.iter().zip(quantity.of.determined());
            all.map(|(value, is_known)| is_known.then_some(*value)).collect()
        };
        let (value, stddev) = (known(&quantity.of.value), known(&quantity.of.stddev));
        (quantity.key.to_owned(), json!({"unit": quantity.unit, "value": value, "stddev": stddev}))
    });
    let misfit = of.misfit.map(
        |misfit| json!({"ratio": misfit.ratio(), "degrees_of_freedom": misfit.dof, "fits": misfit.fits()}),
    );
    rows.into_iter().chain([("misfit".to_owned(), json!(misfit))]).collect()
}
