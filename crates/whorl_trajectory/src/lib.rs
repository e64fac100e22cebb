//! Basic processing of a run's data, before any explanation.
//!
//! Comparison, identification and diagnosis share the same few steps:
//!
//! - [`check`]: whether a recording can be used, and if not, why ([`Refusal`]); [`counts`]: whether it has the model's wheels and jets;
//! - [`noise`]: noise of one sample estimated from the data, interval and jitter of the stamps;
//! - [`bins`]: means of samples over equal stretches of time;
//! - [`line`](mod@line): straight lines through neighbouring samples;
//! - [`commands`]: commands of a run, as the model's actuators receive them;
//! - [`driven_speeds`], [`wheel_torque`]: speeds of wheels whose commands were not recorded, and the torques that explain them;
//! - [`quiet()`]: the model without noise, with the run's supplies;
//! - [`gimbals`]: the measured motion of gimbals;
//! - [`rough_attitude`]: an attitude from two directions, for what begins with one;
//! - [`spectrum`]: Fourier transforms of series.

pub mod bins;
pub mod commands;
pub mod driven_speeds;
pub mod gimbals;
pub mod line;
pub mod noise;
mod quiet;
mod refusal;
pub mod rough_attitude;
pub mod spectrum;
#[cfg(test)]
mod tests;
pub mod wheel_torque;

pub use quiet::quiet;
pub use refusal::{Needs, Refusal, check, counts};
