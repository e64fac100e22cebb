//! The result of a diagnosis.

mod remaining;
mod words;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use whorl_dynamics::PlatformModel;

use crate::fitting::refit::Fit;

/// The verdict of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// One set of effects is supported well above every other.
    Named,
    /// Several sets explain the data equally well.
    Confounded,
    /// Something is missing that no effect of the catalogue explains.
    Unknown,
    /// The model explains the data to the noise, and an effect of ordinary size would have been seen.
    NothingMissing,
    /// The data could not have shown an effect of ordinary size.
    #[default]
    NotEnoughInformation,
}

/// Fitted parameter of a candidate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Name in the catalogue.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Estimate.
    pub estimate: f64,
    /// Standard deviation.
    pub stddev: f64,
    /// Whether the estimate lies at a bound of its plausible range.
    pub at_bound: bool,
    /// The smallest value that these data would have revealed clearly (five standard deviations).
    pub smallest_detectable: f64,
}

impl ParameterEstimate {
    pub(crate) fn new(name: impl Into<String>, unit: &str, estimate: f64, stddev: f64) -> Self {
        let (name, unit) = (name.into(), unit.to_owned());
        Self { name, unit, estimate, stddev, at_bound: false, smallest_detectable: 5.0 * stddev }
    }
}

/// One effect as an explanation of the base model's residual.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Candidate {
    /// Id in the catalogue.
    pub effect: String,
    /// Log evidence gained by adding it to the chosen set; for a term of the set, lost by removing it.
    pub delta_log_evidence: f64,
    /// Log likelihood gained on held-out data; > 0 = predicts better. `None` without any, or where it gained too little to be fitted.
    pub held_out_gain: Option<f64>,
    /// Share of the misfit above the noise that this effect alone brings, of what the answer brings and leaves.
    pub share_of_excess: f64,
    /// Share of its signal that is absorbed by refitting the base parameters.
    pub swallowed_by_base: f64,
    /// Drop of the whitened misfit that it brings, in units of noise variance.
    pub detectability: f64,
    /// Effects that explain these data equally well in its place.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub indistinguishable_from: Vec<String>,
    /// Its parameters.
    pub parameters: Vec<ParameterEstimate>,
}

impl Candidate {
    /// Of an effect that the samples show directly.
    pub(crate) fn seen(effect: &str, drop: f64, gain: f64, parameters: Vec<ParameterEstimate>) -> Self {
        Self {
            effect: effect.to_owned(),
            delta_log_evidence: gain,
            share_of_excess: 1.0,
            detectability: drop,
            parameters,
            ..Self::default()
        }
    }
}

/// The driving variable of a torque or a sensor error that no effect of the catalogue explains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// Recorded variable that it correlates with best: `time`, `yaw_rate`, ...; `gyro_rate` for an error of the gyro's readings.
    pub variable: String,
    /// `body` or `world`: the frame in which the torque's axis is fixed.
    pub frame: String,
    /// Axis in that frame.
    pub axis: String,
    /// Symmetry in the variable: `odd`, `even` or `none`.
    pub parity: String,
    /// Frequency of a line in the spectrum \[Hz\].
    pub frequency_hz: Option<f64>,
    /// Share of the excess misfit that this explains.
    pub share: f64,
    /// Root mean square of what it adds, in [`Self::unit`]; 0 where that is not known.
    #[serde(default)]
    pub size: f64,
    /// Unit of the size.
    #[serde(default)]
    pub unit: String,
}

impl Unknown {
    /// A torque in axes of the body that changes in time by no law that is known.
    pub(crate) fn torque_in_time(size: f64) -> Self {
        let [variable, frame, axis, parity, unit] = ["time", "body", "z", "none", "N m"].map(str::to_owned);
        Self { variable, frame, axis, parity, unit, frequency_hz: None, share: 1.0, size }
    }

    /// Of gyro and attitude sensors that contradict each other, whose innovations have this power over that of the noise.
    pub(crate) fn contradiction(power: f64) -> Self {
        let [variable, axis, parity, unit] = ["gyro_rate", "x", "odd", "rad/s"].map(str::to_owned);
        let share = (1.0 - 1.0 / power).clamp(0.0, 1.0);
        Self { variable, axis, parity, unit, share, ..Self::torque_in_time(0.0) }
    }
}

/// A set of explanations and how probable it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Effects of the catalogue that it holds; empty for none.
    pub effects: Vec<String>,
    /// It also holds something unmodelled.
    pub with_unknown: bool,
    /// Posterior probability, 0 to 1.
    pub probability: f64,
}

/// A parameter of a set that was fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterOfSet {
    /// Effect id; `mass_properties` for the moments of inertia.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Value with the set.
    pub value: f64,
    /// Standard deviation; `None` where the parameter had no column of its own.
    pub stddev: Option<f64>,
}

/// A set of explanations that was fitted, with its worth. Logarithms are natural, up to a constant that all sets of a diagnosis share.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FittedSet {
    /// Effects of the catalogue that it holds; empty for none.
    pub effects: Vec<String>,
    /// What it also holds that is unmodelled: a law beside the effects, or a slow random torque that is no background.
    pub unmodelled: Option<Unknown>,
    /// What was fitted, and where; the platform's own parameters among it. Empty for an unmodelled law.
    pub parameters: Vec<ParameterOfSet>,
    /// Log evidence of the samples of the training runs, values integrated out, with the penalty of how the effects enter.
    pub log_evidence: f64,
    /// Log likelihood that held-out runs gain over the platform's own parameters alone; `None` without any.
    pub held_out_gain: Option<f64>,
    /// Log prior odds against no effect.
    pub log_prior: f64,
    /// Log posterior: both, and what held-out runs gain as far as the effects bring it.
    pub log_posterior: f64,
    /// Posterior probability, 0 to 1; 0 for a set that is not admissible: it does not lower the error.
    pub probability: f64,
    /// How its fit ended; `None` for an unmodelled law, which is evaluated beside the fit of its effects.
    pub termination: Option<Termination>,
    /// Time that the fit took \[s\].
    pub seconds: f64,
}

/// How a fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// At its optimum.
    Converged,
    /// Before its optimum: it was out of reach of what is more probable, or took too many steps.
    GivenUp,
}

/// Slow random torque that was found beside what is explained.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct BackgroundTorque {
    /// Standard deviation about each axis [N m]; 0 = none was found.
    pub stddev_n_m: f64,
    /// Time over which it changes \[s\].
    pub correlation_s: f64,
}

/// Noise of one channel of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoiseScale {
    /// Name of the run.
    pub run: String,
    /// Name of the channel.
    pub channel: String,
    /// Measured noise over that of the model.
    pub scale: f64,
}

/// RMS of the whitened residual summed over stretches of 1 and 8 s, relative to noise alone: no prediction error. If a slow torque is missing, it
/// grows with the length of the stretch.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SlowResidual {
    /// Base refitted, no effect added.
    pub before: f64,
    /// With the effects.
    pub after: f64,
    /// As `before` on held-out runs; `None` without any.
    pub held_out_before: Option<f64>,
    /// As `after` on held-out runs.
    pub held_out_after: Option<f64>,
}

/// The recommended next run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextManoeuvre {
    /// In words.
    pub manoeuvre: String,
    /// Expected log odds between the remaining explanations.
    pub expected_log_odds: f64,
}

/// The result of a diagnosis.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Version of the JSON output.
    pub schema: u32,
    /// The verdict.
    pub verdict: Verdict,
    /// Best supported set, ids of the catalogue; empty if none. Beside something unknown those effects that are there in any case.
    pub effects: Vec<String>,
    /// The platform's own parameters refitted to the samples alone and with the most probable set, by the sets.
    #[serde(skip)]
    pub fits: BTreeMap<Vec<String>, Fit>,
    /// The model with those low-passes that delay, for [`crate::Options::delaying`].
    #[serde(skip)]
    pub delaying: Option<PlatformModel>,
    /// Other sets that the data cannot reject, most probable first.
    pub confounded_with: Vec<Vec<String>>,
    /// All sets with a probability worth mentioning, most probable first.
    #[serde(default)]
    pub explanations: Vec<Explanation>,
    /// `torque`, `actuator`, `sensor` or `hidden_state`, of the first effect.
    pub kind: Option<String>,
    /// Properties of an effect that is not in the catalogue, alone or beside `effects`.
    pub unknown: Option<Unknown>,
    /// Whether half of the effects that were tested would have shown at their ordinary size.
    #[serde(default)]
    pub would_have_shown: bool,
    /// Every effect of the catalogue that was tested, best first.
    pub candidates: Vec<Candidate>,
    /// The slow residual before and after.
    pub slow_residual: SlowResidual,
    /// Slow random torque beside the most probable set.
    #[serde(default)]
    pub background: BackgroundTorque,
    /// Noise of each channel of each run.
    #[serde(default)]
    pub noise: Vec<NoiseScale>,
    /// What to do next.
    pub next: Option<NextManoeuvre>,
    /// Consequences of missing channels, unusual noise and other remarks, one sentence each.
    #[serde(default)]
    pub remarks: Vec<String>,
    /// Every set that was fitted, most probable first.
    #[serde(skip)]
    pub fitted: Vec<FittedSet>,
}

/// Rivals of an explanation that nothing speaks against.
const RIVALS: usize = 3;

impl Diagnosis {
    /// Nothing can be said.
    pub fn not_enough_information() -> Self {
        Self { schema: 3, ..Self::default() }
    }

    /// The sets of effects that a further run should tell apart: those that are left, or where nothing is in doubt the
    /// named one and its nearest rivals, another effect in place of the one that is missed least.
    pub fn contenders(&self) -> Vec<Vec<String>> {
        let mut sets = [std::slice::from_ref(&self.effects), &self.confounded_with].concat();
        if sets.len() == 1 {
            let (own, others): (Vec<&Candidate>, Vec<&Candidate>) =
                self.candidates.iter().partition(|row| self.effects.contains(&row.effect));
            let weakest = own.iter().min_by(|a, b| a.delta_log_evidence.total_cmp(&b.delta_log_evidence));
            let mut kept = self.effects.clone();
            kept.retain(|id| weakest.is_none_or(|row| row.effect != *id));
            let with = |row: &&Candidate| [&kept[..], std::slice::from_ref(&row.effect)].concat();
            sets.extend(others.iter().take(RIVALS).map(with));
        }
        sets.dedup();
        sets
    }
}
