//! On simulated recordings.

use whorl_dynamics::PlatformModel;
use whorl_prediction::PredictionError;
use whorl_recording::Recording;

use crate::Comparison;

mod comparisons;
mod dependence;
#[path = "../../../whorl_prediction/src/tests/generator.rs"]
mod generator;
mod localisation;
mod memory;
mod pendulums;
mod quantities;
mod rigs;
mod statistics;

fn compare(recording: &Recording, model: &PlatformModel) -> Result<Comparison, PredictionError> {
    crate::compare(recording, model, None)
}
