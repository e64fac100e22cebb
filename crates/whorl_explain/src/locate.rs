//! In which regime a model fails.

use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_identification::{Fit, Options, fit, usable_readings};
use whorl_recording::Recording;
use whorl_validation::{Localisation, UnexplainedTorques, explain_where, unexplained_torques};

use crate::adopt::farthest;
use crate::{Case, ExplainError, ProgressCallback};

/// Prior standard deviations by which the platform's own parameters may move to explain a run. If a fit asks for more,
/// they compensate for something else that is missing.
const MOST_STDDEVS: f64 = 5.0;

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
    let plausible = fitted.map_err(|error| error.to_string()).and_then(|fitted| {
        check_plausible(&fitted)?;
        Ok((fitted.model, fitted.followed))
    });
    let ((model, known), not_refitted) = match plausible {
        Ok(fitted) => (fitted, None),
        Err(reason) => ((case.model.clone(), Vec::new()), Some(reason)),
    };
    let used: Vec<_> =
        case.training.iter().chain(case.held_out).map(|run| usable_readings(run, case.model).0).collect();
    let all: Vec<&Recording> = used.iter().map(AsRef::as_ref).collect();
    say(
        0.5,
        &if let [run] = all[..] {
            format!("following {}", run.name)
        } else {
            format!("following {} runs", all.len())
        },
    );
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

/// Checks that the platform's own parameters have moved within their priors; if not, names the worst one.
pub(crate) fn check_plausible(fitted: &Fit) -> Result<(), String> {
    match farthest(fitted, |_| true) {
        Some((worst, stddevs)) if stddevs > MOST_STDDEVS => Err(format!(
            "a refit would move {} of {} by {stddevs:.0} of its prior's standard deviations; the platform's own parameters alone cannot explain the data",
            worst.name, worst.group
        )),
        _ => Ok(()),
    }
}
