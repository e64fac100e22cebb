//! Explains data: functions with typed results.
//!
//! A [`Case`] is the input of all but the last: runs of one platform, its model, and the model's prior.
//!
//! | question | function | answer |
//! |---|---|---|
//! | how far off is the model? | [`compare`] | a [`ComparedRun`] for each run |
//! | where does it fail? | [`locate`] | [`Located`] |
//! | which effect is missing? | [`diagnose`] | [`Explanation`] |
//! | which manoeuvre is most informative? | [`propose()`] | [`Proposal`] |
//! | how much does an effect improve the model? | [`adopt()`] | [`Adoption`] |
//! | what changed from run to run? | [`trends::trends`] | [`trends::Trends`] |
//!
//! Nothing here reads or writes files or prints. The `whorl` command, the pages and other programs call the same
//! functions, so a number with the same name is the same statistic everywhere. All of them report the
//! [`prediction_error`].

pub mod adopt;
pub mod changes;
mod compare;
mod diagnose;
mod error;
mod locate;
pub mod propose;
#[cfg(test)]
mod tests;
pub mod trends;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

pub use adopt::{Adoption, Version, adopt};
pub use compare::{ComparedRun, compare, prediction_error};
pub use diagnose::{Explanation, diagnose};
pub use error::ExplainError;
pub use locate::{Located, locate};
pub use propose::{Proposal, propose};

/// Runs of one platform with its model.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// Training runs: used to fit.
    pub training: &'a [Recording],
    /// Held-out runs: used to test, never to fit.
    pub held_out: &'a [Recording],
    /// The model of the platform, including adopted effects.
    pub model: &'a PlatformModel,
    /// The prior: how well the model is known.
    pub prior: &'a ModelPrior,
}

/// Receives the progress (0 to 1) and the current step of a long computation.
pub type ProgressCallback<'a> = dyn FnMut(f64, &str) + 'a;

/// Progress of a part of a computation, mapped to `from` to `to` of the whole.
fn part<'a>(say: &'a mut ProgressCallback<'_>, from: f64, to: f64) -> impl FnMut(f64, &str) + 'a {
    move |share, doing| say(from + (to - from) * share, doing)
}
