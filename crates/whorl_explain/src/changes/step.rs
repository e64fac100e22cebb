//! A step of a model's history, as entries of its parameter file.

use whorl_params::{ModelStep, Value};

use super::Change;

/// Entries that note a step.
#[must_use]
pub fn of_step(step: &ModelStep) -> Vec<Change> {
    let text = |text: &Option<String>| text.clone().map(Value::String);
    let pair = |pair: Option<[f64; 2]>| pair.map(|pair| Value::DoubleArray(pair.map(to_the_third).to_vec()));
    let effects = (!step.effects.is_empty()).then(|| Value::StringArray(step.effects.clone()));
    let entries = [
        ("date", text(&step.date)),
        ("effects", effects),
        ("prediction_error", pair(step.prediction_error)),
        ("held_out_prediction_error", pair(step.held_out_prediction_error)),
        ("source", text(&step.source)),
    ];
    let given = entries.into_iter().filter_map(|(key, value)| Some((key, value?)));
    given.map(|(key, value)| Change { key: step.key(key), value, comment: String::new() }).collect()
}

/// Three decimals, as `adopt` prints them.
fn to_the_third(x: f64) -> f64 {
    (x * 1000.0).round() / 1000.0
}
