//! What the data of a run say before anything is explained.
//!
//! Comparison, identification and diagnosis stand on the same few steps; each is here once:
//!
//! - [`check`]: whether a recording can be used at all, and if not, what would help ([`Refusal`]);
//! - [`noise`]: noise of one sample as the data show it, steps and jitter of the stamps;
//! - [`bins`]: means of samples over equal stretches of time;
//! - [`line`](mod@line): straight lines through neighbouring samples;
//! - [`commands`]: what the platform was told, as the model's actuators receive it;
//! - [`smoothing`]: attitude, rate, wheel speeds and sensor biases from all of a run's data;
//! - [`residual_torque`]: the torque that a model does not explain, over time;
//! - [`spectrum`]: Fourier transforms of series.

pub mod bins;
pub mod commands;
pub mod line;
pub mod noise;
mod refusal;
mod residual;
pub mod smoothing;
pub mod spectrum;
#[cfg(test)]
mod tests;
pub mod wheel_torque;

pub use refusal::{Needs, Refusal, check};
pub use residual::{ResidualTorque, residual_torque};
