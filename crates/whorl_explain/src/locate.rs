//! In which regime a model fails.

use whorl_diagnosis::{Options, fit};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;
use whorl_validation::{Whereabouts, explain_where};

use crate::{Case, ExplainError, Say};

/// Where a model fails.
#[derive(Debug, Clone)]
pub struct Located {
    /// All runs together.
    pub pooled: Whereabouts,
    /// Each run by itself, training runs first; empty where there is only one.
    pub runs: Vec<Whereabouts>,
    /// The model whose residual torque this is: the platform's own parameters refitted to the training runs.
    pub model: PlatformModel,
    /// Why the platform's own parameters could not be refitted; the model is as given then.
    pub not_refitted: Option<String>,
}

/// Finds the recorded quantities on which the torque that the model does not explain depends: first the platform's own
/// parameters are refitted to the training runs, as a diagnosis does, because what a wrong inertia does is no missing
/// torque; then all runs together are looked at, and each by itself.
///
/// # Errors
/// When a run holds no residual torque: clamped, too short, without a gyro.
pub fn locate(case: &Case<'_>, options: &Options, say: &mut Say<'_>) -> Result<Located, ExplainError> {
    say(0.0, "fitting the platform's own parameters");
    let (model, not_refitted) = match fit(case.training, &[], case.model, case.prior, &[], options) {
        Ok(fitted) => (fitted.model, None),
        Err(error) => (case.model.clone(), Some(error.to_string())),
    };
    let all: Vec<&Recording> = case.training.iter().chain(case.held_out).collect();
    say(0.5, "looking into the runs");
    let pooled = explain_where(&all, &model)?;
    let mut runs = Vec::new();
    for (k, run) in all.iter().enumerate().filter(|_| all.len() > 1) {
        say(0.6 + 0.4 * k as f64 / all.len() as f64, &format!("looking into {}", run.name));
        runs.push(explain_where(std::slice::from_ref(run), &model)?);
    }
    Ok(Located { pooled, runs, model, not_refitted })
}
