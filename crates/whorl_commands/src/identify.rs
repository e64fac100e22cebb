//! Answers of `identify` as data.

use serde_json::{Value, json};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::mass_parameters::{MASS_PARAMETERS, NAMES, UNITS, mass_vector};
use whorl_identification::{Determined, Finding, FittedParameter, Identification};

/// Everything that was identified, beside what the model had before.
#[must_use]
pub fn as_json(platform: &str, model: &PlatformModel, found: &Identification) -> Value {
    let (before, stddev) = (mass_vector(&model.mass_properties), found.stddev());
    let parameters: Vec<Value> = (0..MASS_PARAMETERS)
        .map(|i| {
            json!({
                "name": NAMES[i], "unit": UNITS[i], "before": before[i], "estimate": found.estimate[i],
                "stddev": stddev[i], "prior_stddev": found.prior_stddev[i],
                "determined": determined(found.determined[i]),
            })
        })
        .collect();
    let covariance: Vec<Vec<f64>> =
        found.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    json!({
        "platform": platform,
        "duration_s": found.duration_s,
        "prediction_error": {"before": found.error_before, "after": found.error_after},
        "usable": found.usable(),
        "parameters": parameters,
        "covariance": covariance,
        "others": found.others.iter().map(other_as_json).collect::<Vec<_>>(),
        "findings": findings_as_json(&found.findings),
    })
}

fn other_as_json(p: &FittedParameter) -> Value {
    json!({
        "of": p.group, "name": p.name, "unit": p.unit, "before": p.before, "estimate": p.estimate,
        "stddev": p.stddev, "prior_stddev": p.prior_stddev,
        "determined": determined(Determined::of(p.stddev, p.prior_stddev)), "at_bound": p.at_bound,
    })
}

fn determined(determined: Determined) -> &'static str {
    match determined {
        Determined::Yes => "yes",
        Determined::Hardly => "hardly",
        Determined::No => "no",
    }
}

/// Findings of an identification, a calibration or a balancing.
#[must_use]
pub fn findings_as_json(findings: &[Finding]) -> Vec<Value> {
    findings.iter().map(|finding| json!({"fatal": finding.fatal, "text": finding.text})).collect()
}
