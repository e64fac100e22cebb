//! Runs the diagnosis on a case and compares its result with the sealed answer.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use whorl_identification::{
    Diagnosis, ExpectedInformation, Explanation, Options, Verdict, diagnose, expected_information,
};
use whorl_recording::Recording;

use crate::cases::build::FollowUp;
use crate::cases::foreign::expected;
use crate::cases::{Built, Cell, Spec};

/// Below this the data cannot tell an effect from the most similar one: twice the log likelihood ratio
/// of even odds (a hundred to one), with one or two parameters more.
pub const INSEPARABLE: f64 = 12.0;

/// What one case came to.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome {
    pub spec: Spec,
    pub key: String,
    pub seal: String,
    /// Why the case could not be built, if it could not.
    pub not_built: Option<String>,
    pub truth: Vec<String>,
    pub lambda: f64,
    pub separation: f64,
    pub nearest: Option<String>,
    pub verdict: String,
    pub answer: Vec<String>,
    pub confounded_with: Vec<Vec<String>>,
    /// The most probable explanation, with its probability.
    #[serde(default)]
    pub explanation: Option<Explanation>,
    pub candidates: Vec<(String, f64)>,
    pub unknown_variable: Option<String>,
    pub error: Option<String>,
    /// The best explanation is the truth (also as the first of a confounded set).
    pub first_right: bool,
    /// Named exactly, or confounded rightly with the truth in the set.
    pub exact: bool,
    /// The truth is among the possibilities in the answer.
    pub truth_in_set: bool,
    /// A stated name is neither the true one nor one that the data cannot separate from it.
    pub wrong_name: bool,
    /// Which further run the tool asked for.
    #[serde(default)]
    pub proposed: Option<String>,
    /// With that run: named exactly.
    pub resolved: Option<bool>,
    /// `unknown` where it should be; and the variable.
    pub unknown_right: Option<bool>,
    pub variable_right: Option<bool>,
    /// Held-out error after adoption over the noise floor; and before.
    pub held_out_ratio: Option<f64>,
    pub held_out_ratio_before: Option<f64>,
    /// Intervals that should cover, and those that did.
    pub intervals: u32,
    pub covered: u32,
    /// Each of them.
    #[serde(default)]
    pub estimates: Vec<Interval>,
    pub seconds: f64,
    pub minutes_of_data: f64,
}

/// The true and the estimated value of a parameter.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Interval {
    pub effect: String,
    pub parameter: String,
    pub truth: f64,
    pub estimate: f64,
    pub stddev: f64,
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Named => "named",
        Verdict::Confounded => "confounded",
        Verdict::Unknown => "unknown",
        Verdict::NothingMissing => "nothing_missing",
        Verdict::NotEnoughInformation => "not_enough_information",
    }
}

fn same(a: &[String], b: &[String]) -> bool {
    let sorted = |x: &[String]| {
        let mut x = x.to_vec();
        x.sort();
        x
    };
    sorted(a) == sorted(b)
}

/// Effects that are in every base model: fitting them is not naming them.
fn is_base(id: &str) -> bool {
    matches!(id, "gravity_offset" | "inertia_products" | "gyro_bias")
}

/// An outcome for a case that could not be built.
#[must_use]
pub fn not_built(spec: &Spec, reason: &str) -> Outcome {
    Outcome {
        spec: spec.clone(),
        key: spec.key(),
        seal: String::new(),
        not_built: Some(reason.to_owned()),
        truth: Vec::new(),
        lambda: 0.0,
        separation: 0.0,
        nearest: None,
        verdict: String::new(),
        answer: Vec::new(),
        confounded_with: Vec::new(),
        explanation: None,
        candidates: Vec::new(),
        unknown_variable: None,
        error: None,
        first_right: false,
        exact: false,
        truth_in_set: false,
        wrong_name: false,
        proposed: None,
        resolved: None,
        unknown_right: None,
        variable_right: None,
        held_out_ratio: None,
        held_out_ratio_before: None,
        intervals: 0,
        covered: 0,
        estimates: Vec::new(),
        seconds: 0.0,
        minutes_of_data: 0.0,
    }
}

fn ask(built: &Built, training: &[Recording], threads: usize) -> Result<(Diagnosis, f64), String> {
    let options = Options { threads, ..Options::default() };
    let begun = Instant::now();
    diagnose(training, &built.held_out, &built.model, &built.prior, &options, &mut |_| {})
        .map(|d| (d, begun.elapsed().as_secs_f64()))
        .map_err(|e| e.to_string())
}

/// Prints a whole diagnosis where that is wished.
fn explain(diagnosis: &Diagnosis) {
    if std::env::var_os("WHORL_CHALLENGE_EXPLAIN").is_some() {
        eprintln!("{}", serde_json::to_string_pretty(diagnosis).unwrap_or_default());
    }
}

/// The manoeuvre that the tool would fly next: the one from which it expects most.
fn proposed<'b>(built: &'b Built, diagnosis: &Diagnosis, threads: usize) -> Result<&'b FollowUp, String> {
    // Rehearsed with the estimates of the leading explanation, as `whorl next` does.
    let leading: Vec<(&str, BTreeMap<String, f64>)> = diagnosis
        .candidates
        .iter()
        .filter(|c| diagnosis.effects.contains(&c.effect))
        .map(|c| {
            let values = c.parameters.iter().map(|p| (p.name.clone(), p.estimate)).collect();
            (c.effect.as_str(), values)
        })
        .collect();
    let (follow_ups, rehearsals): (Vec<&FollowUp>, Vec<Recording>) =
        built.follow_ups.iter().filter_map(|f| Some((f, built.rehearsed(f, &leading)?))).unzip();
    let options = Options { threads, ..Options::default() };
    let sets = diagnosis.contenders();
    let (_, expected) =
        expected_information(&built.training, &rehearsals, &built.model, &built.prior, &sets, &options)
            .map_err(|e| e.to_string())?;
    let worth = |p: &ExpectedInformation| (p.log_odds.unwrap_or(0.0), p.shown.len());
    follow_ups
        .into_iter()
        .zip(&expected)
        .max_by(|(_, a), (_, b)| {
            let (a, b) = (worth(a), worth(b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        })
        .map(|(follow_up, _)| follow_up)
        .ok_or_else(|| "no manoeuvre to propose".to_owned())
}

/// Asks the diagnosis, and scores.
#[must_use]
pub fn judge(built: &Built, threads: usize) -> Outcome {
    let answer = &built.answer;
    let mut outcome = Outcome {
        seal: answer.seal(),
        not_built: None,
        truth: answer.effects.clone(),
        lambda: answer.lambda,
        separation: answer.separation.min(1e12),
        nearest: answer.nearest.clone(),
        minutes_of_data: built.training.iter().chain(&built.held_out).map(Recording::duration_s).sum::<f64>()
            / 60.0,
        ..not_built(&built.spec, "")
    };
    let (diagnosis, seconds) = match ask(built, &built.training, threads) {
        Ok(pair) => pair,
        Err(error) => {
            outcome.error = Some(error);
            return outcome;
        }
    };
    outcome.seconds = seconds;
    explain(&diagnosis);
    score(&mut outcome, built, &diagnosis);
    if built.spec.cell == Cell::Confounded {
        match proposed(built, &diagnosis, threads) {
            Ok(follow_up) => {
                outcome.proposed = Some(format!("{:?}", follow_up.style));
                let mut all = built.training.clone();
                all.push(follow_up.recording.clone());
                outcome.resolved = Some(match ask(built, &all, threads) {
                    Ok((after, _)) => {
                        explain(&after);
                        after.verdict == Verdict::Named && same(&after.effects, &answer.effects)
                    }
                    Err(error) => {
                        outcome.error = Some(error);
                        false
                    }
                });
            }
            Err(error) => {
                outcome.error = Some(error);
                outcome.resolved = Some(false);
            }
        }
    }
    outcome
}

fn score(outcome: &mut Outcome, built: &Built, diagnosis: &Diagnosis) {
    let answer = &built.answer;
    let said: Vec<String> = diagnosis.effects.iter().filter(|e| !is_base(e)).cloned().collect();
    outcome.verdict = word(diagnosis.verdict).to_owned();
    outcome.answer = said.clone();
    outcome.confounded_with.clone_from(&diagnosis.confounded_with);
    outcome.explanation = diagnosis.explanations.first().cloned();
    outcome.candidates = diagnosis
        .candidates
        .iter()
        .take(6)
        .map(|c| (c.effect.clone(), (c.delta_log_evidence * 10.0).round() / 10.0))
        .collect();
    outcome.unknown_variable = diagnosis.unknown.as_ref().map(|u| format!("{}/{}", u.variable, u.frame));

    let states_names = matches!(diagnosis.verdict, Verdict::Named | Verdict::Confounded);
    let sets: Vec<&Vec<String>> =
        std::iter::once(&said).chain(&diagnosis.confounded_with).filter(|_| states_names).collect();
    let truth_in_set = sets.iter().any(|set| same(set, &answer.effects));
    outcome.truth_in_set = truth_in_set;
    outcome.first_right = states_names && said.first().is_some_and(|first| answer.effects.contains(first));
    let cannot_tell = answer.separation < INSEPARABLE;
    outcome.exact = match diagnosis.verdict {
        Verdict::Named => same(&said, &answer.effects) && !answer.effects.is_empty(),
        Verdict::Confounded => cannot_tell && truth_in_set,
        Verdict::NothingMissing => answer.effects.is_empty() && answer.foreign.is_none(),
        Verdict::Unknown | Verdict::NotEnoughInformation => false,
    };
    // A confounded set that holds the truth states nothing wrong.
    let allowed =
        |id: &String| answer.effects.contains(id) || (cannot_tell && answer.nearest.as_ref() == Some(id));
    outcome.wrong_name = match diagnosis.verdict {
        Verdict::Named => !said.iter().all(allowed),
        Verdict::Confounded => !truth_in_set && !sets.iter().any(|set| set.iter().all(allowed)),
        _ => false,
    };

    if let Some(name) = &answer.foreign {
        let expected = expected(name);
        let is_close = states_names && said.iter().all(|e| expected.names.contains(&e.as_str()));
        outcome.unknown_right = Some(diagnosis.verdict == Verdict::Unknown);
        outcome.variable_right = Some(
            diagnosis
                .unknown
                .as_ref()
                .is_some_and(|u| expected.variables.iter().any(|v| u.variable.contains(v))),
        );
        outcome.wrong_name = states_names && !is_close;
    }

    outcome.held_out_ratio = diagnosis.slow_residual.held_out_after;
    outcome.held_out_ratio_before = diagnosis.slow_residual.held_out_before;
    if outcome.exact && diagnosis.verdict == Verdict::Named {
        for (id, values) in &answer.comparable {
            let Some(candidate) = diagnosis.candidates.iter().find(|c| c.effect == *id) else { continue };
            for estimate in candidate.parameters.iter().filter(|p| !p.at_bound && p.stddev > 0.0) {
                // A parameter that the truth does not have is zero there.
                let truth = match values.get(&estimate.name) {
                    Some(truth) => *truth,
                    None if is_zero_when_absent(id, &estimate.name) => 0.0,
                    None => continue,
                };
                outcome.intervals += 1;
                outcome.covered += u32::from((estimate.estimate - truth).abs() <= 1.96 * estimate.stddev);
                outcome.estimates.push(Interval {
                    effect: id.clone(),
                    parameter: estimate.name.clone(),
                    truth,
                    estimate: estimate.estimate,
                    stddev: estimate.stddev,
                });
            }
        }
    }
}

/// Parameters that a truth without them has at zero (as one jet of many), so that an interval around zero
/// covers.
#[must_use]
pub fn is_zero_when_absent(effect: &str, _name: &str) -> bool {
    matches!(
        effect,
        "thruster_leak"
            | "wheel_misalignment"
            | "wheel_inertia"
            | "wheel_friction"
            | "thruster_misalignment"
            | "gyro_misalignment"
    )
}
