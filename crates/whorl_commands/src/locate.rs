//! Answers of `where` as data.

use serde_json::json;
use whorl_explain::Located;
use whorl_validation::Localisation;

/// Version of the JSON output.
const SCHEMA: u32 = 4;

/// Everything.
///
/// # Errors
/// When a number cannot be serialised.
pub fn as_json(platform: &str, found: &Located) -> anyhow::Result<serde_json::Value> {
    let one = |where_: &Localisation| -> anyhow::Result<serde_json::Value> {
        let mut value = serde_json::to_value(where_)?;
        if let Some(object) = value.as_object_mut() {
            object.insert("answer".to_owned(), json!(where_.answer()));
        }
        Ok(value)
    };
    Ok(json!({
        "schema": SCHEMA,
        "platform": platform,
        "base_refitted": found.not_refitted.is_none(),
        "pooled": one(&found.pooled)?,
        "runs": found.runs.iter().map(one).collect::<anyhow::Result<Vec<_>>>()?,
    }))
}
