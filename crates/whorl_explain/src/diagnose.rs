//! Which physical effect a model lacks, and in which regime it fails.

use rayon::prelude::*;
use whorl_dynamics::PlatformModel;
use whorl_identification::{Diagnosis, Options, Progress, fit};
use whorl_recording::{Recording, usable_readings};
use whorl_validation::{Localisation, UnexplainedTorques, explain_where, unexplained_torques};

use crate::adopt::{Adoption, prediction_errors, versions};
use crate::{Case, ExplainError, ProgressCallback, Version};

/// A verdict with the numbers behind it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The verdict.
    pub diagnosis: Diagnosis,
    /// The model as given, refitted, and with the named effects, each compared with all runs ([`crate::compare`]), as far as it could be fitted.
    pub versions: Vec<Version>,
    /// Unexplained torque of the first run, without and with the named effects. The platform's own parameters are refitted in both.
    pub torques: Vec<UnexplainedTorques>,
}

/// Finds the effect that the model lacks, and compares the runs with the model that has it.
///
/// # Errors
/// When the recordings cannot be explained at all.
pub fn diagnose(
    case: &Case<'_>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Explanation, ExplainError> {
    let Case { training, held_out, model, prior } = *case;
    let mut progress = |p: Progress| say(0.7 * p.share, p.doing);
    let diagnosis = whorl_identification::diagnose(training, held_out, model, prior, options, &mut progress)?;
    let options = &Options { delaying: diagnosis.delaying.clone(), ..options.clone() };
    let named = diagnosis.effects.clone();
    let sets = if named.is_empty() { &[][..] } else { std::slice::from_ref(&named) };
    let mut rest = |share: f64, doing: &str| say(0.7 + 0.3 * share, doing);
    let Adoption { versions, .. } = versions(case, sets, &diagnosis.fits, options, &mut rest)?;
    let best = versions.iter().rfind(|version| named.is_empty() || !version.effects.is_empty());
    let left = |held_out: bool| best.and_then(|version| version.prediction_error(held_out));
    let diagnosis = diagnosis.held_against(left(false), left(true), &options.settings);
    Ok(Explanation { torques: unexplained(case, &versions), diagnosis, versions })
}

fn unexplained(case: &Case<'_>, versions: &[Version]) -> Vec<UnexplainedTorques> {
    let Some(recording) = case.training.first() else { return Vec::new() };
    let torques = |version: &Version| {
        let model = version.fit.as_ref().map_or(case.model, |fit| &fit.model);
        let known = version.runs.first().map(|run| &run.comparison.followed);
        unexplained_torques(&usable_readings(recording, case.model).0, model, known).ok()
    };
    let before = versions.iter().rfind(|version| version.effects.is_empty());
    let after = versions.iter().find(|version| !version.effects.is_empty());
    before.into_iter().chain(after).map_while(torques).collect()
}

impl Explanation {
    /// The verdict in a few sentences, most important first, with the prediction error of each version.
    pub fn answer(&self) -> Vec<String> {
        self.diagnosis.answer().into_iter().chain(prediction_errors(&self.versions)).collect()
    }
}

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

/// Finds the recorded quantities on which the unexplained torque depends, of all runs together and of each by itself. First the platform's own
/// parameters are refitted to the training runs: the error of a wrong inertia is no missing torque. What is missing is noise to this fit.
///
/// # Errors
/// When a run cannot be followed: too short, without a gyro, or on a bench without wheel speeds.
pub fn locate(
    case: &Case<'_>,
    options: &Options,
    say: &mut ProgressCallback<'_>,
) -> Result<Located, ExplainError> {
    say(0.0, "fitting the platform's own parameters");
    let (model, known, not_refitted) = match fit(case.training, case.model, case.prior, &[], options) {
        Ok(fit) => (fit.model, fit.followed, None),
        Err(error) => (case.model.clone(), Vec::new(), Some(error.to_string())),
    };
    say(0.5, "following the runs");
    let all: Vec<&Recording> = case.training.iter().chain(case.held_out).collect();
    let used: Vec<_> = all.iter().map(|run| usable_readings(run, case.model).0).collect();
    let torques_of = |(i, run)| unexplained_torques(run, &model, known.get(i));
    let torques: Vec<_> = used.par_iter().map(AsRef::as_ref).enumerate().map(torques_of).collect();
    let torques: Vec<UnexplainedTorques> = torques.into_iter().collect::<Result<_, _>>()?;
    say(0.9, "analysing the runs");
    let with_torques: Vec<(&Recording, _)> = used.iter().map(AsRef::as_ref).zip(&torques).collect();
    let pooled = explain_where(&with_torques, &model);
    let each = with_torques.iter().filter(|_| all.len() > 1);
    let runs = each.map(|run| explain_where(&[*run], &model)).collect();
    Ok(Located { pooled, runs, torques, model, not_refitted })
}
