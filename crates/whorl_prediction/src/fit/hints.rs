//! What recordings say of more than was fitted.

use nalgebra::{DMatrix, DVector};
use whorl_recording::Recording;

use super::ModelAt;
use super::problem::{Problem, runs_of};
use crate::error::PredictionError;
use crate::laws::Laws;
use crate::levels::Followed;
use crate::parameter::Parameter;
use crate::passes::Pass;
use crate::settings::Settings;

/// What a recording says of parameters and of laws that no model has, about a model that was fitted: log p of a small change x
/// is `slope . x - x . information x / 2` more. Parameters first, in their units, then the sizes of the laws.
#[derive(Debug, Clone, PartialEq)]
pub struct Hints {
    /// -d^2 log p / dx^2, Gauss and Newton's, without what is known before.
    pub information: DMatrix<f64>,
    /// d log p / dx of the recordings alone.
    pub slope: DVector<f64>,
    /// log p of the recording there.
    pub log_likelihood: f64,
}

/// Normal equations of each recording about a model with these values; `laws` of each recording, which are as many.
///
/// # Errors
/// As [`super::fit`].
pub fn hints(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    at: &[f64],
    followed: &[Followed],
    laws: &[Laws<'_>],
    settings: &Settings,
) -> Result<Vec<Hints>, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let found = problem.passes_with(at, &runs_of(followed), &problem.varied(at)?, laws)?;
    let of_run = |pass: &Pass| Hints {
        information: pass.sums.information.clone(),
        slope: pass.sums.slope.clone(),
        log_likelihood: pass.log_likelihood(),
    };
    Ok(found.0.iter().map(of_run).collect())
}
