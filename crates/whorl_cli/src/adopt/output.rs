//! Versions as JSON.

use serde_json::json;
use whorl_explain::Version;

use crate::runs::Runs;

/// Version of the JSON output.
const SCHEMA: u32 = 2;

pub fn as_json(
    runs: &Runs,
    versions: &[Version],
    answer: &[String],
    provenance: &str,
) -> anyhow::Result<serde_json::Value> {
    let mut list = Vec::new();
    for version in versions {
        let parameters = version.fit.as_ref().map_or_else(Vec::new, |fit| {
            let estimates = fit.estimates.iter();
            estimates
                .map(|p| {
                    json!({"of": p.group, "name": p.name, "unit": p.unit, "before": p.before,
                           "estimate": p.estimate, "stddev": p.stddev, "at_bound": p.at_bound})
                })
                .collect()
        });
        let mut compared = Vec::new();
        for run in &version.runs {
            let mut value = serde_json::to_value(&run.comparison)?;
            if let Some(object) = value.as_object_mut() {
                object.insert("held_out".to_owned(), json!(run.held_out));
            }
            compared.push(value);
        }
        list.push(json!({
            "name": version.name,
            "effects": version.effects,
            "prediction_error": version.prediction_error(false),
            "held_out_prediction_error": version.prediction_error(true),
            "parameters": parameters,
            "runs": compared,
        }));
    }
    Ok(json!({
        "schema": SCHEMA,
        "platform": runs.known.platform,
        "answer": answer,
        "provenance": provenance,
        "versions": list,
    }))
}
