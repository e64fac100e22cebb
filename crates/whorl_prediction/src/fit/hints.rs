//! What recordings say of more than was fitted.

use nalgebra::{DMatrix, DVector};
use whorl_recording::Recording;

use super::ModelAt;
use super::problem::{Problem, runs_of};
use crate::error::PredictionError;
use crate::laws::Laws;
use crate::levels::Followed;
use crate::parameter::Parameter;
use crate::settings::Settings;

/// What recordings say of parameters and of laws that no model has, about a model that was fitted to them: log p of a small change x
/// is `slope . x - x . information x / 2` more. Parameters first, in their units, then the sizes of the laws.
#[derive(Debug, Clone, PartialEq)]
pub struct Hints {
    /// -d^2 log p / dx^2, Gauss and Newton's, without what is known before.
    pub information: DMatrix<f64>,
    /// d log p / dx of the recordings alone.
    pub slope: DVector<f64>,
}

/// Looks for laws beside a model with these values; `laws` of each recording, which are as many.
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
) -> Result<Hints, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let found = problem.passes_with(at, &runs_of(followed), &problem.varied(at)?, laws)?;
    let size = parameters.len() + laws.first().map_or(0, Laws::count);
    let mut hints = Hints { information: DMatrix::zeros(size, size), slope: DVector::zeros(size) };
    for pass in &found.0 {
        hints.information += &pass.sums.information;
        hints.slope += &pass.sums.slope;
    }
    Ok(hints)
}
