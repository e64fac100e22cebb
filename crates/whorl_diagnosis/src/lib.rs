//! Which physical effect a platform's model lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`]
//! refits the model jointly with named effects.
//!
//! # Method
//!
//! The model is linearised about a trajectory that is smoothed from the measurements. Along it, the
//! model predicts every sample. The residuals pass through a Kalman filter over attitude, rate, wheel
//! speeds and sensor biases, which whitens them to unit variance. The sensitivities of every sample to
//! the parameters of the platform and of every candidate effect pass through the same filter. The
//! result is an ordinary regression with white noise. In it the candidates compete, and the platform's
//! own parameters are always refitted within their priors. This is the generalised least-squares form
//! of the integrated (momentum) residual: no noisy rate is differentiated.

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

/// A search, repeated if a gyro bias that wanders more than the model says may look like a missing effect, or may be
/// hidden by a sensor effect.
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

/// Sets the gyro's bias walk [rad/s/sqrt(s)].
fn expect_walk(walk: f64, problem: &mut problem::Problem, held_out: Option<&mut problem::Problem>) {
    for problem in std::iter::once(problem).chain(held_out) {
        problem.gyro_bias_walk = walk;
    }
}

/// Result of a search.
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

/// Log evidence of a member that no plausible gyro noise could cause.
pub(crate) const BEYOND_NOISE: f64 = 300.0;

/// Whether each named effect exceeds what noise could cause.
fn is_strong(diagnosis: &Diagnosis) -> bool {
    matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded) && !is_faint(diagnosis)
}

/// Whether noise of another kind than the model's could have caused the verdict.
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

/// Checks the inputs and divides the recordings into bins. `late_s` is the latency of the inertial units' stamps, if it
/// differs from the model's.
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
    // All runs, including held-out ones, use bins of the same width, chosen to limit the number of nodes.
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
    /// Standard deviations after the fit.
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
    /// Value in the given model (for an effect that it does not have: the neutral value).
    pub before: f64,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation of the estimate.
    pub stddev: f64,
    /// Whether the estimate lies at a bound of its plausible range.
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
