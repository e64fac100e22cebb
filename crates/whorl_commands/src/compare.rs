//! Answers of `compare` as data.

use anyhow::bail;
use serde_json::json;
use whorl_explain::{Adoption, Case, ComparedRun, ProgressCallback, adopt, prediction_error};
use whorl_validation::comparison::PREDICTION_RULE;

use crate::options;

/// Version of the JSON output.
const SCHEMA: u32 = 3;

/// All runs compared with the model as given, and with its own parameters refitted.
///
/// # Errors
/// When a run cannot be compared, or the parameters cannot be refitted.
pub fn refitted(
    case: &Case<'_>,
    say: &mut ProgressCallback<'_>,
) -> anyhow::Result<(Vec<ComparedRun>, Vec<ComparedRun>)> {
    let Adoption { versions, left_out } = adopt(case, &[], &options(), say)?;
    let mut versions = versions.into_iter();
    match (versions.next(), versions.next(), left_out.first()) {
        (Some(given), Some(refitted), _) => Ok((given.runs, refitted.runs)),
        (.., Some((_, error))) => bail!("the platform's own parameters cannot be refitted: {error}"),
        _ => bail!("the platform's own parameters cannot be refitted"),
    }
}

/// Everything of one platform; `given` are the runs compared with the model as given, where it was refitted.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_json(
    platform: &str,
    compared: &[ComparedRun],
    given: Option<&[ComparedRun]>,
) -> anyhow::Result<serde_json::Value> {
    let mut list = Vec::new();
    for run in compared {
        let mut value = serde_json::to_value(&run.comparison)?;
        if let Some(object) = value.as_object_mut() {
            object.insert("held_out".to_owned(), json!(run.held_out));
            object.insert("answer".to_owned(), json!(run.comparison.answer()));
            object.insert("innovations".to_owned(), json!(run.comparison.said_of_innovations()));
        }
        list.push(value);
    }
    Ok(json!({
        "schema": SCHEMA,
        "platform": platform,
        "prediction_rule": PREDICTION_RULE,
        "prediction_error": prediction_error(compared, false),
        "held_out_prediction_error": prediction_error(compared, true),
        "refitted": given.is_some(),
        "prediction_error_as_given": given.and_then(|runs| prediction_error(runs, false)),
        "held_out_prediction_error_as_given": given.and_then(|runs| prediction_error(runs, true)),
        "runs": list,
    }))
}
