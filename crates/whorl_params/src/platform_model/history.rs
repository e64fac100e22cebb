//! The shared group `model_history`: how a platform's model came to be, one group `step_1`, `step_2`, ... for each change
//! that a command made.

use crate::limits::non_negative;
use crate::reader::Reader;
use crate::shared_groups::HISTORY_GROUP;

/// What names of its groups begin with.
const STEP: &str = "step_";

/// A change of a platform's model, as the command noted it that made it.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelStep {
    /// Which: 1 for the first.
    pub number: u32,
    /// When, in UTC (2026-03-02T10:15:00Z).
    pub date: Option<String>,
    /// Effects that were adopted, by their ids; empty for an identification or a calibration.
    pub effects: Vec<String>,
    /// Prediction error on the training runs over the noise, before and after.
    pub prediction_error: Option<[f64; 2]>,
    /// The same on held-out runs.
    pub held_out_prediction_error: Option<[f64; 2]>,
    /// Runs and command.
    pub source: Option<String>,
}

impl ModelStep {
    /// A step of which only the source is known yet: an identification, a calibration.
    #[must_use]
    pub fn of_source(source: String) -> Self {
        Self {
            number: 0,
            date: None,
            effects: Vec::new(),
            prediction_error: None,
            held_out_prediction_error: None,
            source: Some(source),
        }
    }

    /// Key of a value of this step below the platform's section.
    #[must_use]
    pub fn key(&self, of: &str) -> String {
        format!("{HISTORY_GROUP}.{STEP}{}.{of}", self.number)
    }
}

/// Reads the steps, oldest first.
pub fn model_history(r: &mut Reader<'_>) -> Vec<ModelStep> {
    r.claim_group(HISTORY_GROUP);
    let mut steps = Vec::new();
    for name in r.children(HISTORY_GROUP) {
        let key = format!("{HISTORY_GROUP}.{name}");
        match name.strip_prefix(STEP).and_then(|number| number.parse().ok()) {
            Some(number) => steps.push(r.group(&key, |r| step(r, number))),
            None => r.reject_group(&key, "allowed: step_1, step_2, ..."),
        }
    }
    steps.sort_by_key(|step: &ModelStep| step.number);
    steps
}

fn step(r: &mut Reader<'_>, number: u32) -> ModelStep {
    ModelStep {
        number,
        date: r.optional_string("date", "when the model was changed, in UTC"),
        effects: r.string_array_or("effects", &[], "effects that were adopted"),
        prediction_error: before_and_after(r, "prediction_error", "training"),
        held_out_prediction_error: before_and_after(r, "held_out_prediction_error", "held-out"),
        source: r.optional_string("source", "runs and command"),
    }
}

fn before_and_after(r: &mut Reader<'_>, key: &str, runs: &str) -> Option<[f64; 2]> {
    if !r.has(key) {
        return None;
    }
    let doc = format!("prediction error on {runs} runs over the noise, before and after");
    let values = r.f64_array(key, non_negative(), &doc);
    let pair = <[f64; 2]>::try_from(values.as_slice()).ok();
    if pair.is_none() && !values.is_empty() {
        r.reject(key, "allowed: two numbers, before and after");
    }
    pair
}
