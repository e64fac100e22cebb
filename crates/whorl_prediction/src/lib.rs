//! One causal, model-based predictor at the sample rate: innovations, predictions ahead, starts that the data show, and the
//! exact likelihood of a recording.
//!
//! A filter carries the plant of a model from stamp to stamp with the recorded commands; each reading corrects it in the order
//! of the instants that the readings show. What a reading is less its prediction from everything before, the innovation, is
//! white and of the predicted size if the model is right, also where a controller answers to the readings. The equations are in
//! METHOD.md beside this crate's sources.
//!
//! ```
//! use whorl_dynamics::{InitialState, Plant, PlatformModel};
//! use whorl_prediction::{Noise, Prepared, Settings, fitted_start, predict};
//!
//! let model = PlatformModel::whorl_1_reference();
//! let mut plant = Plant::new(&model, &InitialState::default(), 1)?;
//! let mut recording = whorl_recording::Recording::default();
//! for k in 0..100 {
//!     plant.advance_to(k * 10_000_000)?;
//!     recording.gyro_b_rad_s.time_s.push(k as f64 * 0.01);
//!     recording.gyro_b_rad_s.value.push(plant.sample_imu().angular_velocity_rad_s);
//! }
//! let case = Prepared::new(&recording, &model, Settings::default())?;
//! let noise = Noise::stated(&case)?;
//! let fitted = fitted_start(&case, &noise);
//! let found = predict(&case, &noise, &fitted.start, &[], &mut |_| {});
//! assert!(found.misfit() < 2.0, "{} of the square that the model predicts", found.misfit());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod blocks;
mod cells;
mod columns;
mod filter;
mod fit;
mod fitted;
mod frozen;
mod gains;
mod innovations;
mod inputs;
mod laws;
mod levels;
mod linearisation;
mod noise;
mod other;
mod passes;
mod perturbed;
mod predict;
mod prepared;
mod readings;
mod recursive;
mod refusal;
mod rows;
mod settings;
mod smoothed;
mod start;
mod stop;
#[cfg(test)]
mod tests;
mod trail;

pub use filter::{Likelihood, likelihood};
pub use fit::{Fitted, Hints, ModelAt, Parameter, Rival, fit, hints};
pub use fitted::{FittedStart, fitted_start};
pub use innovations::{Innovation, instants_on_this_thread};
pub use laws::{Laws, Push};

pub use frozen::{frozen_gains, innovations};
pub use levels::{Followed, follow, follow_again, followed_with, longest_cell_s};
pub use noise::{Disturbance, Layout, Noise, RandomTorque};
pub use other::Varied;
pub use passes::sensitivities;
pub use perturbed::{Difference, InState, Perturbed};
pub use predict::{AheadError, Told, predict, simulate};
pub use prepared::Prepared;
pub use recursive::{Reading, Recursive, Since};
pub use refusal::{Needs, PredictionError, Refusal, Why, check};
pub use settings::{CELL_S, Setting, Settings};
pub use smoothed::{SmoothedState, smoothed};
pub use start::Start;
pub use stop::Stop;
pub use trail::Trail as FrozenGains;
