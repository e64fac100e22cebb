//! In which regime a model fails.

use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_identification::{Options, fit, usable_readings};
use whorl_recording::Recording;
use whorl_validation::{Localisation, UnexplainedTorques, explain_where, unexplained_torques};

use crate::adopt::implausible;
use crate::{Case, ExplainError, ProgressCallback};

/// Prior standard deviations by which the platform's own parameters may move to explain a run. If a fit asks for more,
/// they compensate for something else that is missing.
pub(crate) const MOST_STDDEVS: f64 = 5.0;

/// Where a model fails.
#[derive(Debug, Clone)]
pub struct Located {
    /// All runs together.
    pub pooled: Localisation,
    /// Each run by itself, training runs first; empty where there is only one.
    pub runs: Vec<Localisation>,
    /// The unexplained torques themselves, run by run, for plots.
    pub torques: Vec<UnexplainedTorques>,
    /// The model that leaves them: the platform's own parameters refitted to the training runs.
    pub model: PlatformModel,
    /// Why the platform's own parameters were not refitted, if so; then the model is the given one.
    pub not_refitted: Option<String>,
}

/// Finds the recorded quantities on which the unexplained torque depends.
///
/// First the platform's own parameters are refitted to the training runs, as in a diagnosis, because the error of a
/// wrong inertia is no missing torque. If they would have to move implausibly far, something else is missing, and they
/// stay as given. Then all runs are analysed together, and each by itself.
///
/// # Errors
/// When a run cannot be followed: too short, without a gyro, or on a bench without wheel speeds.
pub fn locate(
    case: &Case<'_>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Located, ExplainError> {
    say(0.0, "fitting the platform's own parameters");
    let fitted = fit(case.training, case.model, case.prior, &[], options);
    let (model, known, not_refitted) = match fitted {
        Err(error) => (case.model.clone(), Vec::new(), Some(error.to_string())),
        Ok(fitted) => match implausible(&fitted, MOST_STDDEVS, |_| true) {
            None => (fitted.model, fitted.followed, None),
            reason => (case.model.clone(), Vec::new(), reason),
        },
    };
    let used: Vec<_> =
        case.training.iter().chain(case.held_out).map(|run| usable_readings(run, case.model).0).collect();
    let all: Vec<&Recording> = used.iter().map(AsRef::as_ref).collect();
    say(0.5, "following the runs");
    let torques_of = |(i, run): (usize, &&Recording)| unexplained_torques(run, &model, known.get(i));
    let torques: Vec<_> = all.par_iter().enumerate().map(torques_of).collect();
    let torques: Vec<UnexplainedTorques> = torques.into_iter().collect::<Result<_, _>>()?;
    say(0.9, "analysing the runs");
    let with_torques: Vec<_> = all.iter().copied().zip(&torques).collect();
    let pooled = explain_where(&with_torques, &model)?;
    let mut runs = Vec::new();
    for run in with_torques.iter().filter(|_| all.len() > 1) {
        runs.push(explain_where(&[*run], &model)?);
    }
    Ok(Located { pooled, runs, torques, model, not_refitted })
}
