//! Which physical effect a platform's model lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`]
//! refits the model jointly with named effects.
//!
//! # Method
//!
//! Two likelihoods of the same recordings are used. A causal filter at the rate of the samples ([`whorl_prediction`]) fits the
//! platform's own parameters within their priors, has a column for every effect, and decides which sets explain the data; laws that no
//! effect has are looked for in it too. A linear regression over bins of a smoothed motion, whitened by a Kalman filter, proposes
//! effects with shapes and hidden states and first values. See METHOD.md of this crate.

mod bins;
mod diagnosis;
mod directions;
mod error;
mod evidence;
mod explanations;
mod fitter;
pub mod laws;
mod low_pass;
mod options;
mod parameters;
mod refit;
mod search;
mod settings;
#[cfg(test)]
mod tests;
mod threads;
mod ties;
mod verdict;
mod whitening;

pub use diagnosis::{
    BackgroundTorque, Candidate, Diagnosis, Explanation, FittedSet, NextManoeuvre, NoiseScale,
    ParameterEstimate, ParameterOfSet, SCHEMA, SlowResidual, Unknown, Verdict,
};
pub use directions::{Direction, Directions, Measured, Suspect, directions};
pub use error::DiagnosisError;
pub use fitter::{Fitter, fit};
pub use options::{Options, Progress};
pub use refit::{Fit, FittedParameter};
pub use search::expected_information::{ExpectedInformation, InformationByRun, expected_information};
pub use settings::{Allowed, Setting, Settings};
pub use ties::Tie;

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

use parameters::available::Available;
use search::Search;
use search::judge::{Judge, Judgement, Said};
use search::latency::FoundLatency;

/// Finds the effect that the model lacks.
///
/// `held_out` recordings are used to test, never to fit. `progress` is called repeatedly from this thread.
///
/// # Errors
/// If the recordings cannot be analysed: see [`DiagnosisError`].
pub fn diagnose(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    let stated = model;
    let model = options.delaying.as_ref().unwrap_or(stated);
    let (mut problem, mut held) = prepare(training, held_out, model, prior, options, None, progress)?;
    if let Some(run) = problem.runs.iter().find(|run| run.is_blind()) {
        let mut diagnosis = Diagnosis::not_enough_information();
        diagnosis.remarks = problem.runs.iter().flat_map(|r| r.remarks.clone()).collect();
        diagnosis.remarks.push(format!(
            "{}: the gyro alone, without measured wheel speeds, cannot distinguish a missing effect from the wheels' momentum and the tilt; record the wheel speeds, the accelerometer or a vector sensor",
            run.name
        ));
        return Ok(diagnosis);
    }
    progress(Progress { share: 0.0, doing: "comparing what the sensors' low-pass may be" });
    let delaying = delaying(&problem, training, options)?;
    if delaying != *model {
        (problem, held) = prepare(training, held_out, &delaying, prior, options, None, progress)?;
    }
    let model = &delaying;
    let noted = |mut diagnosis: Diagnosis| {
        diagnosis.remarks.extend(low_pass::remarks(stated, model));
        diagnosis
    };
    let recordings = (training, held_out);
    let said = Said::default();
    let (search, without) = searched(&mut problem, held.as_mut(), recordings, options, said, progress)?;
    let Some(extra_latency_s) =
        without.worth_new_bins(search.0.problem.reference.extra_latency_s, &options.settings)
    else {
        return Ok(noted(answer(search, recordings, progress)?));
    };
    let said = Said::in_search(search.0, search.1);
    drop((problem, held));
    let (mut problem, mut held) =
        prepare(training, held_out, model, prior, options, Some(extra_latency_s), progress)?;
    let (search, latency) = searched(&mut problem, held.as_mut(), recordings, options, said, progress)?;
    if latency.explains_more_than_others(&without, &options.settings) {
        return Ok(noted(answer(search, recordings, progress)?));
    }
    let said = Said::in_search(search.0, search.1);
    drop((problem, held));
    let (mut problem, mut held) = prepare(training, held_out, model, prior, options, None, progress)?;
    let (search, _) = searched(&mut problem, held.as_mut(), recordings, options, said, progress)?;
    Ok(noted(answer(search, recordings, progress)?))
}

/// A search, with the reference against which its sets are judged.
type Searched<'a> = (Search<'a>, Option<Judgement<'a>>);

/// A search, and what it found of a latency.
fn searched<'a>(
    problem: &'a mut evidence::problem::Problem,
    held_out: Option<&'a mut evidence::problem::Problem>,
    (training, held_out_recordings): (&'a [Recording], &'a [Recording]),
    options: &'a Options,
    said: Said,
    progress: &mut dyn FnMut(Progress),
) -> Result<(Searched<'a>, FoundLatency), DiagnosisError> {
    let available = Available::of(&problem.runs);
    let judge = Judge { training, held_out: held_out_recordings, available, threads: options.threads };
    let mut search = Search::start(problem, held_out, options, progress)?;
    search.said = said;
    let judgement = search.run(judge, progress)?;
    let latency = FoundLatency::of(&search);
    Ok(((search, judgement), latency))
}

/// The answer of a search, judged by the samples.
fn answer(
    (mut search, judgement): Searched<'_>,
    recordings: (&[Recording], &[Recording]),
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    search.judge_remaining(judgement, progress)?;
    progress(Progress { share: 0.92, doing: "looking for laws without a name, writing the answer" });
    let mut diagnosis = search.answer(recordings.0)?;
    diagnosis.fits = search.fits_of([Vec::new(), diagnosis.effects.clone()])?;
    if let Some(remark) = verdict::unrecorded::pulses(&search)? {
        return Ok(diagnosis.withheld(remark));
    }
    if let (Some(what), Some(first)) = (search.implausible_inertia(), search.problem.runs.first()) {
        let other = DiagnosisError::OtherPlatform { run: first.name.clone(), what };
        // A missing effect that nothing explains may bias the model as much.
        if diagnosis.verdict != Verdict::Unknown {
            return Err(other);
        }
        diagnosis.remarks.push(other.to_string());
    }
    Ok(diagnosis)
}

/// The model without those low-passes of its inertial sensors that do not delay as stated. Whoever diagnoses and fits the same recordings finds
/// it once, for [`Options::delaying`].
///
/// # Errors
/// As [`diagnose`].
pub fn with_low_passes_that_delay(
    training: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
) -> Result<PlatformModel, DiagnosisError> {
    let (problem, _) = prepare(training, &[], model, prior, options, None, &mut |_| {})?;
    delaying(&problem, training, options)
}

fn delaying(
    problem: &evidence::problem::Problem,
    training: &[Recording],
    options: &Options,
) -> Result<PlatformModel, DiagnosisError> {
    let stated = &problem.reference.model;
    match &options.delaying {
        Some(known) => Ok(known.clone()),
        None if problem.runs.iter().any(bins::run::Run::is_blind) => Ok(stated.clone()),
        None => {
            let found = low_pass::without_those_that_do_not_delay(problem, training, options.threads)?;
            Ok(found.unwrap_or_else(|| stated.clone()))
        }
    }
}

/// Checks the inputs and divides the recordings into bins. `extra_latency_s` is the latency of the inertial units' stamps, if it
/// differs from the model's.
fn prepare(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    extra_latency_s: Option<f64>,
    progress: &mut dyn FnMut(Progress),
) -> Result<(evidence::problem::Problem, Option<evidence::problem::Problem>), DiagnosisError> {
    progress(Progress { share: 0.0, doing: "reading the recordings" });
    if training.is_empty() {
        return Err(DiagnosisError::NoRecording);
    }
    for id in &options.exclude {
        if whorl_dynamics::effects::find(id).is_none() {
            return Err(DiagnosisError::UnknownEffect { id: id.clone() });
        }
    }
    let mut reference = parameters::Reference::new(model, prior);
    reference.settings = options.settings;
    reference.extra_latency_s = extra_latency_s.unwrap_or(reference.extra_latency_s);
    // All runs, including held-out ones, use bins of the same width, chosen to limit the number of nodes.
    let recordings = training.iter().chain(held_out);
    let total_s: f64 = recordings.map(Recording::duration_s).sum();
    let problem = evidence::problem::Problem::new(training, reference.clone(), total_s, options.threads)?;
    let held = if held_out.is_empty() {
        None
    } else {
        Some(evidence::problem::Problem::new(held_out, reference, total_s, options.threads)?)
    };
    Ok((problem, held))
}
