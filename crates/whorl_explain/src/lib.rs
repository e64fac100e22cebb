//! Explaining data, as functions that return data.
//!
//! A [`Case`] is what is explained: runs of one platform, its model, and how well that is known.
//!
//! | question | function | answer |
//! |---|---|---|
//! | how far off is the model? | [`compare`] | [`ComparedRun`] for each run |
//! | where does it fail? | [`locate`] | [`Located`] |
//! | which effect is missing? | [`diagnose`] | [`Explanation`] |
//! | which manoeuvre would tell more? | [`propose`] | [`Proposal`] |
//! | what does an effect bring? | [`adopt`] | [`Adoption`] |
//!
//! Nothing here reads or writes files or prints. The `whorl` command, the pages and other programs call the same
//! functions, so that a number with the same name is the same statistic everywhere; the one that all of them share is
//! the [`prediction_error`].

pub mod adopt;
mod compare;
mod diagnose;
mod error;
mod locate;
pub mod propose;
#[cfg(test)]
mod tests;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

pub use adopt::{Adoption, Version, adopt};
pub use compare::{ComparedRun, compare, prediction_error};
pub use diagnose::{Explanation, UnexplainedTorque, diagnose};
pub use error::ExplainError;
pub use locate::{Located, locate};
pub use propose::{Proposal, propose};

/// Runs of one platform with its model.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// Runs that may be fitted.
    pub training: &'a [Recording],
    /// Runs that judge and never fit.
    pub held_out: &'a [Recording],
    /// The platform as it is known, adopted effects included.
    pub model: &'a PlatformModel,
    /// How well it is known.
    pub prior: &'a ModelPrior,
}

impl<'a> Case<'a> {
    /// The same runs with another model.
    #[must_use]
    pub fn with_model<'b>(self, model: &'b PlatformModel) -> Case<'b>
    where
        'a: 'b,
    {
        Case { model, ..self }
    }
}

/// Is told how far a long computation is (0 to 1) and what it is doing.
pub type Say<'a> = dyn FnMut(f64, &str) + 'a;

/// A part of a progress: from `from` to `to` of the whole.
fn part<'a>(say: &'a mut Say<'_>, from: f64, to: f64) -> impl FnMut(f64, &str) + 'a {
    move |share, doing| say(from + (to - from) * share, doing)
}
