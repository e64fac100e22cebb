//! One causal, model-based predictor at the sample rate: innovations, predictions ahead, starts that the data show, and the exact likelihood of a recording.
//!
//! A filter carries the plant of a model with the recorded commands; each reading corrects it in the order of the instants that they show. Readings less
//! predictions, the innovations, are white and of the predicted size if the model is right, also where a controller answers. METHOD.md has the equations.

mod blocks;
mod columns;
mod commands;
mod driven_speeds;
mod error;
mod filter;
mod fit;
mod fitted;
mod gains;
mod innovations;
mod laws;
mod levels;
mod noise;
mod other;
mod passes;
mod perturbed;
mod predict;
mod prepared;
mod readings;
mod recursive;
mod rows;
mod settings;
mod smoothed;
mod start;
mod stop;
#[cfg(test)]
mod tests;
mod trail;
mod within;

pub use error::PredictionError;
pub use filter::Likelihood;
pub use fit::{Fitted, Hints, ModelAt, Parameter, Rival, fit, hints};
pub use fitted::{FittedStart, fitted_start};
pub use innovations::{Innovation, instants_on_this_thread};
pub use laws::{Laws, Push};
pub use levels::{Followed, follow, follow_again, follow_like, followed_with, longest_cell_s};
pub use noise::{Disturbance, Layout, Noise, RandomTorque};
pub use other::Varied;
pub use passes::{FrozenGains, frozen_gains, innovations, sensitivities};
pub use perturbed::{Difference, InState, Perturbed};
pub use predict::{AheadError, Told, predict, simulate};
pub use prepared::Prepared;
pub use recursive::{Reading, Recursive, Since};
pub use settings::{CELL_S, Setting, Settings};
pub use smoothed::{SmoothedState, smoothed};
pub use start::Start;
pub use stop::Stop;
