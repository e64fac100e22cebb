//! Which physical effect a platform's model lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`]
//! refits the model jointly with named effects.
//!
//! # Method
//!
//! A trajectory smoothed from the measurements is the point of linearisation. Along it the model
//! predicts every sample; what is left passes through a Kalman filter over attitude, rate, wheel
//! speeds and sensor biases, which turns it into a sequence of white numbers of unit variance. The
//! sensitivity of every sample to every parameter of the platform and of every candidate effect
//! passes through the same filter. The result is one ordinary regression with white noise, in which
//! candidates compete, with the platform's own parameters always refitted within their priors. This is
//! the generalised least-squares form of the integrated (momentum) residual: no derivative of a noisy
//! rate is taken.

mod adequacy;
mod answer;
mod candidates;
mod columns;
mod converge;
mod diagnosis;
mod direct;
mod error;
mod excess;
mod feedback;
mod filter;
mod fit;
mod hypothesis;
mod inputs;
mod jitter;
mod latency;
mod mechanics;
mod modes;
mod motion;
mod noise;
mod options;
mod parameters;
mod physical;
mod problem;
mod prospect;
mod regression;
mod report;
mod run;
mod search;
mod shapes;
mod spectrum;
mod step;
mod surroundings;
#[cfg(test)]
mod tests;
mod threads;
mod ties;
mod unknown;
mod unrecorded;
mod vibration;
mod wander;
mod words;

pub use diagnosis::{
    Candidate, Diagnosis, NextManoeuvre, ParameterEstimate, SCHEMA, SlowResidual, Unknown, Verdict,
};
pub use error::DiagnosisError;
pub use options::{Options, Progress};
pub use prospect::{Prospect, Prospects, prospects};

use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_recording::Recording;

/// Finds the effect that the model lacks.
///
/// `held_out` recordings judge and never fit. `progress` is called now and then from this thread.
///
/// # Errors
/// When the recordings cannot be explained at all: see [`DiagnosisError`].
pub fn diagnose(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    let (mut problem, mut held) = prepare(training, held_out, model, prior, options, None, progress)?;
    if let Some(run) = problem.runs.iter().find(|run| run.is_blind()) {
        let mut diagnosis = Diagnosis::not_enough_information();
        diagnosis.remarks = problem.runs.iter().flat_map(|r| r.remarks.clone()).collect();
        diagnosis.remarks.push(format!(
            "{}: the gyro alone, with wheels whose speed nobody measured, cannot tell a missing effect from the wheels' momentum and the tilt; record the wheel speeds, the accelerometer or a vector sensor",
            run.name
        ));
        return Ok(diagnosis);
    }
    let first = search_allowing_for_bias(&mut problem, held.as_mut(), options, progress)?;
    let Some(late_s) = first.late.worth_a_new_layout(problem.reference.late_s) else {
        return Ok(first.diagnosis);
    };
    drop((problem, held));
    let (mut problem, mut held) = prepare(training, held_out, model, prior, options, Some(late_s), progress)?;
    let second = search_allowing_for_bias(&mut problem, held.as_mut(), options, progress)?;
    let is_late = second.late.explains_more_than_others(&first.late);
    Ok(if is_late { second.diagnosis } else { first.diagnosis })
}

/// A search, and another one if a gyro whose bias wanders more than the model says looks like something that is missing,
/// or hides behind a sensor effect.
fn search_allowing_for_bias(
    problem: &mut problem::Problem,
    mut held: Option<&mut problem::Problem>,
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Answer, DiagnosisError> {
    let mut searched = answer(problem, held.as_deref_mut(), options, true, progress)?;
    if let Searched::Wanders(walk) = searched {
        expect_walk(walk, problem, held.as_deref_mut());
        searched = answer(problem, held.as_deref_mut(), options, false, progress)?;
    }
    if !problem.has_steady_bias() {
        let walk = problem.gyro_bias_walk;
        // What was found on the way must hold in the end.
        if let Searched::Answered(answer) = searched
            && !is_strong(&answer.diagnosis)
            && problem.with_steady_bias().likeliest_gyro_bias_walk(&answer.point)? == Some(walk)
        {
            return Ok(answer.wandering(walk));
        }
        expect_walk(problem::STEADY_BIAS_WALK, problem, held.as_deref_mut());
        searched = answer(problem, held.as_deref_mut(), options, false, progress)?;
    }
    let Searched::Answered(first) = searched else { return Err(step::NO_FIT) };
    let (diagnosis, point) = (&first.diagnosis, &first.point);
    let walk = if is_faint(diagnosis) { problem.likeliest_gyro_bias_walk(point)? } else { None };
    let Some(walk) = walk else { return Ok(*first) };
    let contradicts = diagnosis.verdict == Verdict::Unknown && direct::contradicts(problem, point);
    expect_walk(walk, problem, held.as_deref_mut());
    // What contradicts the gyro however its bias wanders would do so after another search.
    if contradicts && direct::contradicts(problem, point) {
        return Ok(*first);
    }
    match answer(problem, held, options, false, progress)? {
        Searched::Answered(answer) => Ok(answer.wandering(walk)),
        Searched::Wanders(_) => Ok(*first),
    }
}

/// Lets the gyro's bias walk by this much [rad/s/sqrt(s)].
fn expect_walk(walk: f64, problem: &mut problem::Problem, held_out: Option<&mut problem::Problem>) {
    for problem in std::iter::once(problem).chain(held_out) {
        problem.gyro_bias_walk = walk;
    }
}

/// What a search found.
struct Answer {
    diagnosis: Diagnosis,
    /// Where the search ended.
    point: parameters::Point,
    late: latency::Late,
}

impl Answer {
    fn wandering(mut self, walk: f64) -> Self {
        self.diagnosis.remarks.push(format!(
            "the gyro's bias wanders by {walk:.0e} rad/s/sqrt(s), more than the model says (bias_walk_rad_s_sqrt_s); this is taken into account"
        ));
        self
    }
}

/// What became of a search.
enum Searched {
    Answered(Box<Answer>),
    /// The first effect was faint, and beside it the gyro's bias wanders by so much [rad/s/sqrt(s)]: this must be taken
    /// into account from the start.
    Wanders(f64),
}

/// One search, which ends early if it `watches` the gyro's bias.
fn answer(
    problem: &mut problem::Problem,
    held_out: Option<&mut problem::Problem>,
    options: &Options,
    watches: bool,
    progress: &mut dyn FnMut(Progress),
) -> Result<Searched, DiagnosisError> {
    let mut search = search::Search::start(problem, held_out, options, progress)?;
    if let Some(walk) = search.run(watches, progress)? {
        return Ok(Searched::Wanders(walk));
    }
    progress(Progress { share: 0.95, doing: "writing the answer" });
    let mut diagnosis = search.answer();
    if let Some(remark) = unrecorded::pulses(&search)? {
        diagnosis = diagnosis.withheld(remark);
        let late = latency::Late::of(&search);
        return Ok(Searched::Answered(Box::new(Answer { diagnosis, point: search.point, late })));
    }
    if let (Some(what), Some(first)) = (search.beyond_belief(), search.problem.runs.first()) {
        let other = DiagnosisError::OtherPlatform { run: first.name.clone(), what };
        // What nothing explains may bend the model as much.
        if diagnosis.verdict != Verdict::Unknown {
            return Err(other);
        }
        diagnosis.remarks.push(other.to_string());
    }
    let late = latency::Late::of(&search);
    Ok(Searched::Answered(Box::new(Answer { diagnosis, point: search.point, late })))
}

/// Log evidence of a member that no noise of a plausible gyro could make.
pub(crate) const BEYOND_NOISE: f64 = 300.0;

/// Whether each named effect is beyond what noise could make.
fn is_strong(diagnosis: &Diagnosis) -> bool {
    matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded) && !is_faint(diagnosis)
}

/// Whether noise of another kind than the model's could have made a verdict.
fn is_faint(diagnosis: &Diagnosis) -> bool {
    match diagnosis.verdict {
        Verdict::Unknown => true,
        Verdict::Named | Verdict::Confounded => diagnosis
            .candidates
            .iter()
            .any(|c| diagnosis.effects.contains(&c.effect) && c.delta_log_evidence < BEYOND_NOISE),
        Verdict::NothingMissing | Verdict::NotEnoughInformation => false,
    }
}

/// Checks everything and lays the recordings out, stamps of inertial units late by `late_s` if that is not what the
/// model says.
fn prepare(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    options: &Options,
    late_s: Option<f64>,
    progress: &mut dyn FnMut(Progress),
) -> Result<(problem::Problem, Option<problem::Problem>), DiagnosisError> {
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
    reference.late_s = late_s.unwrap_or(reference.late_s);
    // All runs, held-out ones as well, in bins of one width: so many that there are not too many nodes.
    let recordings = training.iter().chain(held_out);
    let total_s: f64 = recordings.map(Recording::duration_s).sum();
    let problem = problem::Problem::new(training, reference.clone(), total_s, options.threads)?;
    let held = if held_out.is_empty() {
        None
    } else {
        Some(problem::Problem::new(held_out, reference, total_s, options.threads)?)
    };
    Ok((problem, held))
}

/// A model refitted jointly with effects.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The platform with base parameters and effects at their estimates.
    pub model: PlatformModel,
    /// How well they are known after the fit.
    pub prior: ModelPrior,
    /// Every fitted parameter of the base model and of the effects.
    pub estimates: Vec<FittedParameter>,
    /// The slow residual before and after.
    pub slow_residual: SlowResidual,
}

/// One fitted parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedParameter {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value in the model that was given (for an effect that it did not have: the neutral value).
    pub before: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation of the estimate.
    pub stddev: f64,
    /// The estimate lies at the end of its plausible range.
    pub at_bound: bool,
}

/// Refits the platform's own parameters together with `effects` (ids of the catalogue, empty to refit the
/// base only) to the training recordings.
///
/// # Errors
/// As [`diagnose`]; also for an unknown effect.
pub fn fit(
    training: &[Recording],
    held_out: &[Recording],
    model: &PlatformModel,
    prior: &ModelPrior,
    effects: &[&str],
    options: &Options,
) -> Result<Fit, DiagnosisError> {
    let mut chosen = Vec::new();
    for id in effects {
        let effect = whorl_dynamics::effects::find(id)
            .ok_or_else(|| DiagnosisError::UnknownEffect { id: (*id).to_owned() })?;
        chosen.push(effect);
    }
    let mut late_s = None;
    loop {
        let (mut problem, mut held) =
            prepare(training, held_out, model, prior, options, late_s, &mut |_| {})?;
        let mut search = search::Search::start(&mut problem, held.as_mut(), options, &mut |_| {})?;
        prospect::make_columns_for(&mut search, effects)?;
        search.adopt(&chosen)?;
        let later_s = latency::Late::of(&search).worth_a_new_layout(search.problem.reference.late_s);
        if late_s.is_some() || later_s.is_none() {
            return search.fit();
        }
        late_s = later_s;
    }
}
