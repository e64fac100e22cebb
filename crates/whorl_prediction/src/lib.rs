//! One causal, model-based predictor at the sample rate: innovations, predictions ahead, starts that the data show, and the
//! exact likelihood of a recording.
//!
//! A filter carries the plant of a model from stamp to stamp with the recorded commands; each reading corrects it in the order
//! of the instants that the readings show. What a reading is less its prediction from everything before, the innovation, is
//! white and of the predicted size if the model is right, also where a controller answers to the readings. The equations are in
//! METHOD.md beside this crate's sources.
//!
//! ```
//! use nalgebra::Vector3;
//! use whorl_dynamics::platform::TiltLimit;
//! use whorl_dynamics::{Freedom, InitialState, Plant, PlatformModel};
//! use whorl_prediction::{Noise, Prepared, Settings, fitted_start, predict};
//! use whorl_recording::Recording;
//!
//! // A body in free fall whose gyro is read a hundred times.
//! let mut model = PlatformModel::whorl_1_reference();
//! (model.freedom, model.tilt_limit) = (Freedom::Free, TiltLimit::NONE);
//! let start = InitialState { omega_wb_b_rad_s: Vector3::new(0.1, -0.2, 0.3), ..InitialState::default() };
//! let mut plant = Plant::new(&model, &start, 1)?;
//! let mut recording = Recording { name: "tumbling".to_owned(), ..Recording::default() };
//! for k in 0..100 {
//!     plant.advance_to(k * 10_000_000)?;
//!     recording.gyro_b_rad_s.time_s.push(k as f64 * 0.01);
//!     recording.gyro_b_rad_s.value.push(plant.sample_imu().angular_velocity_rad_s);
//! }
//!
//! let case = Prepared::new(&recording, &model, Settings::default())?;
//! let noise = Noise::stated(&case)?;
//! let fitted = fitted_start(&case, &noise);
//! let found = predict(&case, &noise, &fitted.start, &[], &mut |_| {});
//! let ratio = (found.chi_squared / (found.numbers as f64 - fitted.determined)).sqrt();
//! assert!((ratio - 1.0).abs() < 0.15, "{ratio} of what the model predicts");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod ahead;
mod blocks;
mod cells;
mod claims;
mod collected;
mod columns;
mod design;
mod error;
mod filter;
mod fit;
mod fitted;
mod from_start;
mod frozen;
mod gains;
mod guess;
mod heading;
mod information;
mod innovations;
mod inputs;
mod kept_gains;
mod known;
mod lanes;
mod laws;
mod layout;
mod levels;
mod likelihood;
mod linearisation;
mod means;
mod noise;
mod other;
mod parameter;
mod passes;
mod perturbed;
mod predict;
mod prepared;
mod readings;
mod recursive;
mod refusal;
mod rows;
mod sensitivities;
mod settings;
mod since;
mod smoothed;
mod start;
mod stop;
mod sums;
#[cfg(test)]
mod tests;
mod transition;

pub use ahead::AheadError;
pub use error::PredictionError;
pub use fit::{Fitted, Hints, ModelAt, Rival, fit, fit_beside, hints};
pub use fitted::{FittedStart, fitted_start};
pub use frozen::{frozen_gains, innovations};
pub use innovations::{Innovation, instants_on_this_thread};
pub use kept_gains::FrozenGains;
pub use laws::{Laws, Push};
pub use layout::Layout;
pub use levels::{Followed, follow, follow_again, follow_as, followed_with};
pub use likelihood::{Likelihood, likelihood};
pub use means::longest_cell_s;
pub use noise::{Disturbance, Noise, RandomTorque};
pub use other::Varied;
pub use parameter::Parameter;
pub use perturbed::{Difference, InState, Perturbed};
pub use predict::{Told, predict, simulate};
pub use prepared::Prepared;
pub use recursive::{Reading, Recursive, Window};
pub use refusal::{Needs, Refusal, check};
pub use sensitivities::sensitivities;
pub use settings::{CELL_S, Setting, Settings};
pub use smoothed::{SmoothedState, smoothed};
pub use start::Start;
pub use stop::Stop;
