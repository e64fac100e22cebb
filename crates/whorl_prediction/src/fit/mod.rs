//! Parameters of a model by the likelihood of recordings: Gauss and Newton's steps through the filter's own sensitivities.
//!
//! Values and levels of noise are found by turns ([`search`]): at fixed levels the values ascend to the maximum of the posterior ([`ascent`]), and with them the levels
//! are found anew.

mod ascent;
mod problem;
mod search;

use nalgebra::{Cholesky, DMatrix, DVector};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;

use crate::laws::Laws;
use crate::levels::{Followed, judged_again};
use crate::noise::Noise;
use crate::passes::Pass;
use crate::refusal::PredictionError;
use crate::settings::Settings;

use problem::{Problem, runs_of};

/// A parameter of a family of models, counted in a unit of its own from where nothing is known better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// What is known before: its standard deviation about zero; infinite: nothing.
    pub stddev: f64,
    /// Smallest and largest value.
    pub range: (f64, f64),
}

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
/// platform has are passed over. A model that competes with another one begins with its levels and starts, and is given up where twice the
/// predicted gain of a step does not bring it to what it needs; [`Fitted::stands`] then is false.
///
/// # Errors
/// See [`PredictionError`]; one of the starts must be a model.
pub fn fit(
    recordings: &[Recording],
    parameters: &[Parameter],
    model_at: &ModelAt<'_>,
    starts: &[Vec<f64>],
    rival: Rival<'_>,
    settings: &Settings,
) -> Result<Fitted, PredictionError> {
    let problem = Problem { recordings, parameters, model_at, settings };
    let begun = problem.begun(starts, rival.followed)?;
    let log_posterior_before = begun.log_posterior;
    let mut best = problem.settled(begun, rival.log_posterior_needed)?;
    let judged = problem.each(&best.iterate.at, |case, run| {
        Ok(judged_again(case, &Noise::stated(case)?, &best.iterate.followed[run]))
    })?;
    if runs_of(&judged) != runs_of(&best.iterate.followed) {
        best.information = None;
    }
    best.iterate = problem.iterate(&best.iterate.at, judged);
    // Beside disturbances parameters hardly matter, and both shrink slowly: the model without them may explain everything by now.
    let undisturbed = problem.without_disturbance(&best.iterate).filter(|_| !best.is_hopeless);
    if let Some(undisturbed) = undisturbed {
        let undisturbed = problem.settled(undisturbed, best.iterate.log_posterior)?;
        if undisturbed.iterate.log_posterior > best.iterate.log_posterior {
            best = undisturbed;
        }
    }
    let (at, followed) = (best.iterate.at, best.iterate.followed);
    let information = match best.information {
        Some(found) => found,
        None => problem.normal_equations(&at, &problem.passes(&at, &runs_of(&followed))?).2,
    };
    let n = parameters.len();
    let root = Cholesky::new(information);
    let covariance = root.as_ref().map_or_else(|| DMatrix::from_element(n, n, f64::NAN), Cholesky::inverse);
    // log of the posterior's determinant over the prior's.
    let narrower: f64 = root.map_or(f64::NAN, |root| root.l().diagonal().iter().map(|x| x.ln()).sum());
    let known: f64 = parameters.iter().filter(|p| p.stddev.is_finite()).map(|p| p.stddev.ln()).sum();
    let log_posterior = best.iterate.log_posterior;
    Ok(Fitted {
        covariance,
        at_bound: problem.held(&at, &DVector::zeros(n)),
        at,
        followed,
        log_posterior,
        log_posterior_before,
        log_evidence: log_posterior - narrower - known,
        stands: best.stands,
    })
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
/// As [`fit`].
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
    let (varied, runs) = (problem.varied(at)?, runs_of(followed));
    problem.each(at, |case, run| {
        let (noise, start) = runs.get(run).ok_or(PredictionError::NoModel)?;
        let Pass { sums, slope, likelihood, .. } =
            Pass::of(case, noise, start, &varied, laws.get(run), false)?;
        Ok(Hints { information: sums.information, slope, log_likelihood: likelihood.log })
    })
}
