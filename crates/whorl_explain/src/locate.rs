//! In which regime a model fails.

use whorl_diagnosis::{Fit, Options, fit};
use whorl_dynamics::PlatformModel;
use whorl_recording::Recording;
use whorl_validation::{Whereabouts, explain_where};

use crate::adopt::belief::farthest;
use crate::{Case, ExplainError, Say};

/// Standard deviations of what is known of them by which own parameters may move to explain a run. A fit that asks for
/// more bends them for something else that is missing.
const MOST_STDDEVS: f64 = 5.0;

/// Where a model fails.
#[derive(Debug, Clone)]
pub struct Located {
    /// All runs together.
    pub pooled: Whereabouts,
    /// Each run by itself, training runs first; empty where there is only one.
    pub runs: Vec<Whereabouts>,
    /// The model whose residual torque this is: the platform's own parameters refitted to the training runs.
    pub model: PlatformModel,
    /// Why the platform's own parameters were not refitted; the model is as given then.
    pub not_refitted: Option<String>,
}

/// Finds the recorded quantities on which the torque that the model does not explain depends: first the platform's own
/// parameters are refitted to the training runs, as a diagnosis does, because what a wrong inertia does is no missing
/// torque (where they would have to move beyond belief, something else is missing, and they stay as given); then all runs together are looked at, and each by itself.
///
/// # Errors
/// When a run holds no residual torque: clamped, too short, without a gyro.
pub fn locate(case: &Case<'_>, options: &Options, say: &mut Say<'_>) -> Result<Located, ExplainError> {
    say(0.0, "fitting the platform's own parameters");
    let fitted = fit(case.training, &[], case.model, case.prior, &[], options);
    let believed = fitted.map_err(|error| error.to_string()).and_then(|fitted| {
        believed(case, &fitted)?;
        Ok(fitted.model)
    });
    let (model, not_refitted) = match believed {
        Ok(model) => (model, None),
        Err(reason) => (case.model.clone(), Some(reason)),
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

/// Whether the platform's own parameters have moved within what is known of them; if not, which one has not.
pub(crate) fn believed(case: &Case<'_>, fitted: &Fit) -> Result<(), String> {
    match farthest(case.model, case.prior, &fitted.model) {
        Some((name, stddevs)) if stddevs > MOST_STDDEVS => Err(format!(
            "a refit would move {name} by {stddevs:.0} standard deviations of what is known of it; more than the platform's own parameters is missing"
        )),
        _ => Ok(()),
    }
}
