//! Parameters of a model by the likelihood of recordings: Gauss and Newton's steps through the filter's own sensitivities.
//!
//! Values and levels of noise are found by turns ([`search`]): at fixed levels the values ascend to the maximum of the posterior ([`ascent`]), and with them the levels
//! are found anew.

mod ascent;
mod hints;
mod problem;
mod search;

use nalgebra::{DMatrix, DVector};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::error::PredictionError;
use crate::levels::Followed;
use crate::parameter::Parameter;
use crate::settings::Settings;

pub use hints::{Hints, hints};
use problem::Problem;

/// Models by their parameters; `None` where no platform has such values.
pub type ModelAt<'a> = dyn Fn(&[f64]) -> Option<PlatformModel> + Sync + 'a;

/// Parameters that recordings show.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The likeliest values, prior included.
    pub at: Vec<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Which stay at an end of their range.
    pub at_bound: Vec<bool>,
    /// Each recording with the model there.
    pub followed: Vec<Followed>,
    /// log p of the recordings and the values, with the levels of noise that each shows [natural logarithm].
    pub log_posterior: f64,
    /// The same where the fit began.
    pub log_posterior_before: f64,
    /// log p of the recordings, whatever the values: Laplace's integral over a normal posterior.
    pub log_evidence: f64,
    /// Whether the values stand.
    pub stands: bool,
}

/// Fits parameters to recordings, beginning with the likeliest of these values, and never less likely than it. Values that no
/// platform has are passed over.
///
/// # Errors
/// See [`PredictionError`]; one of the starts must be a model.
pub fn fit(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    starts: &[Vec<f64>],
    settings: &Settings,
) -> Result<Fitted, PredictionError> {
    fit_beside(recordings, parameters, model_at, starts, Rival::NONE, settings)
}

/// The same of a model that competes with another one: with its levels and starts it begins, and it is given up where twice the
/// predicted gain of a step does not bring it to what it needs; [`Fitted::stands`] then is false.
///
/// # Errors
/// As [`fit`].
pub fn fit_beside(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    starts: &[Vec<f64>],
    rival: Rival<'_>,
    settings: &Settings,
) -> Result<Fitted, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let begun = match rival.followed {
        [] => problem.begun(starts)?,
        followed => problem.begun_beside(starts, followed)?,
    };
    let before = begun.log_posterior;
    let mut best = problem.settled(begun, rival.log_posterior_needed)?;
    let judged = problem.judged_again(&best.iterate)?;
    if judged.runs() != best.iterate.runs() {
        best.information = None;
    }
    best.iterate = judged;
    // Beside disturbances parameters hardly matter, and both shrink slowly: the model without them may explain everything by now.
    let undisturbed = problem.without_disturbance(&best.iterate).filter(|_| !best.is_hopeless);
    if let Some(undisturbed) = undisturbed {
        let undisturbed = problem.settled(undisturbed, best.iterate.log_posterior)?;
        if undisturbed.iterate.log_posterior > best.iterate.log_posterior {
            best = undisturbed;
        }
    }
    let information = match best.information {
        Some(found) => found,
        None => problem.passes(&best.iterate.at, &best.iterate.runs())?.information(parameters),
    };
    let held = problem.held(&best.iterate.at, &DVector::zeros(parameters.len()));
    Ok(problem.fitted(best.iterate, before, &information, &held, best.stands))
}

/// A model that was fitted to the same recordings.
#[derive(Debug, Clone, Copy)]
pub struct Rival<'a> {
    /// Each recording with it; none: a fit begins anew.
    pub followed: &'a [Followed],
    /// What a fit must reach to be of use [natural logarithm].
    pub log_posterior_needed: f64,
}

impl Rival<'_> {
    /// Nobody.
    pub const NONE: Self = Self { followed: &[], log_posterior_needed: f64::NEG_INFINITY };
}
