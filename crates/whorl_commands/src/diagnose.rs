//! Answers of `diagnose` as data.

use whorl_explain::{ExplainError, Explanation, ProgressCallback, diagnose};
use whorl_identification::{FittedSet, Options};

use crate::next;
use crate::runs::Runs;

/// Diagnoses the runs, and recommends the next run where explanations remain that these runs do not separate.
///
/// # Errors
/// When the recordings cannot be explained at all.
pub fn with_next(
    runs: &Runs,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Explanation, ExplainError> {
    let mut found = diagnose(&runs.case(), options, &mut |share, doing| say(0.8 * share, doing))?;
    let mut rest = |share: f64, doing: &str| say(0.8 + 0.2 * share, doing);
    if let Some(next) = next::suggestion(runs, &found.diagnosis, options, &mut rest) {
        found.diagnosis.next = Some(next);
    }
    found.diagnosis.remarks.extend(runs.gaps());
    Ok(found)
}

/// Every set that was fitted, one JSON object a line ([`whorl_identification::FittedSet`]), most probable first.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_lines(fitted: &[FittedSet]) -> anyhow::Result<String> {
    let mut text = String::new();
    for set in fitted {
        text.push_str(&serde_json::to_string(set)?);
        text.push('\n');
    }
    Ok(text)
}

/// The diagnosis, with the prediction error of each version of the model.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_json(found: &Explanation) -> anyhow::Result<serde_json::Value> {
    let mut value = serde_json::to_value(&found.diagnosis)?;
    let versions: Vec<serde_json::Value> = found
        .versions
        .iter()
        .map(|v| {
            serde_json::json!({
                "name": v.name,
                "effects": v.effects,
                "prediction_error": v.prediction_error(false),
                "held_out_prediction_error": v.prediction_error(true),
            })
        })
        .collect();
    if let Some(object) = value.as_object_mut() {
        object.insert("versions".to_owned(), versions.into());
    }
    Ok(value)
}
