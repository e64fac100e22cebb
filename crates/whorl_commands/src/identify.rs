//! Answers of `identify` as data.

use serde_json::{Value, json};
use whorl_dynamics::PlatformModel;
use whorl_identification::mass_parameters::{MASS_PARAMETERS, NAMES, UNITS, mass_vector};
use whorl_identification::{Finding, Identification};

/// Everything that was identified, beside what the model had before.
#[must_use]
pub fn as_json(platform: &str, model: &PlatformModel, found: &Identification) -> Value {
    let (before, stddev) = (mass_vector(&model.mass_properties), found.stddev());
    let parameters: Vec<Value> = (0..MASS_PARAMETERS)
        .map(|i| {
            json!({
                "name": NAMES[i], "unit": UNITS[i], "before": before[i], "estimate": found.estimate[i],
                "stddev": stddev[i], "stddev_known_actuators": found.stddev_known_actuators[i],
                "prior_stddev": found.prior_stddev[i],
                "determined": format!("{:?}", found.determined[i]).to_lowercase(),
            })
        })
        .collect();
    let effects: Vec<Value> = found
        .effects
        .iter()
        .map(|p| {
            json!({"effect": p.effect, "name": p.name, "unit": p.unit, "estimate": p.value, "stddev": p.stddev})
        })
        .collect();
    let covariance: Vec<Vec<f64>> =
        found.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    json!({
        "platform": platform,
        "duration_s": found.duration_s,
        "residual_over_noise": found.reduced_chi_squared.sqrt(),
        "usable": found.usable(),
        "parameters": parameters,
        "covariance": covariance,
        "effects": effects,
        "findings": findings_as_json(&found.findings),
    })
}

/// Findings of an identification, a calibration or a balancing.
#[must_use]
pub fn findings_as_json(findings: &[Finding]) -> Vec<Value> {
    findings.iter().map(|finding| json!({"fatal": finding.fatal, "text": finding.text})).collect()
}
