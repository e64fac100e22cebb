//! The manoeuvre that best separates the remaining explanations.

mod family;
#[cfg(test)]
mod tests;

use rayon::iter::{Either, IntoParallelIterator, ParallelIterator};
use whorl_dynamics::PlatformModel;
use whorl_dynamics::effects::find;
use whorl_identification::{Diagnosis, ExpectedInformation, Options, Verdict, expected_information};
use whorl_math::{deg_from_rad, vertical_b};
use whorl_recording::{Mounting, Recording};

use self::family::tilt_rad;
use crate::{Case, ExplainError, ProgressCallback};
pub use family::{Manoeuvre, family};

/// Shares of its full size to which a manoeuvre beyond the limits is scaled down.
const SCALES: [f64; 4] = [1.0, 0.75, 0.56, 0.42];
/// Share of the log odds that decide by which more outweighs a shorter run: one of so many.
const STEPS: f64 = 20.0;
/// Log odds above which an explanation counts as decided.
const DECIDED: f64 = 6.0;

/// A manoeuvre with its expected information.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// Its demands on the platform.
    pub demand: ManoeuvreDemand,
    /// Its expected information.
    pub expected: ExpectedInformation,
    /// Its motion in simulation.
    pub motion: Recording,
}

/// Demands of a manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ManoeuvreDemand {
    /// Length \[s\].
    pub duration_s: f64,
    /// Largest tilt that counts against the platform's limit \[deg\].
    pub tilt_deg: f64,
    /// The limit \[deg\].
    pub tilt_limit_deg: f64,
    /// Fastest rate [deg/s].
    pub rate_deg_s: f64,
    /// Largest share of a wheel's speed limit.
    pub wheel_speed_share: f64,
    /// Share of a full tank.
    pub gas_share: f64,
}

impl ManoeuvreDemand {
    fn of(recording: &Recording, model: &PlatformModel) -> Self {
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let truth = recording.truth.iter();
        let attitudes = truth.clone().flat_map(|truth| &truth.q_world_body.value);
        let rates = truth.flat_map(|truth| &truth.omega_wb_b_rad_s.value);
        let wheels = recording.wheel_speed_rad_s.value.iter().flat_map(|all| all.iter().zip(model.wheels()));
        let jets = recording.jet_pulses.iter().zip(model.jets());
        let impulses_n_s = jets.flat_map(|(all, jet)| all.iter().map(|p| (p.off_s - p.on_s) * jet.thrust_n));
        let (tank, limit) = (model.tank(), model.tilt_limit);
        Self {
            duration_s: recording.duration_s(),
            tilt_deg: deg_from_rad(largest(&mut attitudes.map(|q| tilt_rad(limit, &vertical_b(q))))),
            tilt_limit_deg: deg_from_rad(limit.max_rad()),
            rate_deg_s: deg_from_rad(largest(&mut rates.map(|w| w.norm()))),
            wheel_speed_share: largest(&mut wheels.map(|(s, w)| s.abs() / w.max_speed_rad_s)),
            // As a thrust's rate of gas, so an impulse's gas.
            gas_share: tank.gas_rate_kg_s(impulses_n_s.sum()) / tank.initial_gas_kg().max(1e-9) + 0.0,
        }
    }

    /// The exceeded limit, if any.
    fn objection(&self) -> Option<String> {
        // A share, and the largest that a manoeuvre may use.
        let shares = [
            (self.tilt_deg / self.tilt_limit_deg, 0.92, "the tilt at which the bearing stops"),
            (self.wheel_speed_share, 0.8, "a wheel's speed"),
            (self.gas_share, 0.2, "a full tank"),
        ];
        let beyond = shares.into_iter().find(|(share, most, _)| share > most);
        beyond.map(|(share, _, of)| format!("takes {:.0} % of {of}", 100.0 * share))
    }
}

/// The proposal and the alternatives.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// The sets of effects to separate; the empty set is the current model.
    pub explanations: Vec<Vec<String>>,
    /// Information in the data at hand.
    pub now: ExpectedInformation,
    /// All manoeuvres within the limits, best first; at least one.
    pub judged: Vec<Judged>,
    /// Manoeuvres that cannot be simulated or are beyond the limits, with the reason.
    pub left_out: Vec<(String, String)>,
    /// Whether the aim is to separate explanations; otherwise it is to show more effects.
    pub separates: bool,
}

/// Simulates an experiment, given by name and text of its file, on the platform that the leading explanation has fitted; the recording, or why not.
pub type Rehearse<'a> = dyn Fn(&str, &str) -> Result<Recording, String> + Sync + 'a;

/// Rehearses every manoeuvre of the family on `platform`, and evaluates the information that each would add to the data at hand.
///
/// # Errors
/// For a clamped platform, and one that cannot make any of the manoeuvres within its limits.
pub fn propose(
    case: &Case<'_>,
    platform: &str,
    diagnosis: &Diagnosis,
    options: &Options,
    rehearse: &Rehearse<'_>,
    say: &mut ProgressCallback<'_>,
) -> Result<Proposal, ExplainError> {
    if case.training.iter().all(|run| run.mounting == Mounting::Clamped) {
        let bench = "all runs are of a clamped platform, and manoeuvres are designed for a free one: for a bench test let every wheel coast down from full speed to both sides, then brake it through zero";
        return Err(ExplainError::Refused(bench.to_owned()));
    }
    say(0.0, "rehearsing manoeuvres in simulation");
    // Scaled down if necessary; what it is expected to show is left open.
    let rehearsed = |index: usize| {
        let mut beyond = (String::new(), String::new());
        for manoeuvre in SCALES.iter().filter_map(|scale| family(case.model, *scale).into_iter().nth(index)) {
            let name = manoeuvre.name.to_owned();
            let motion = match rehearse(&name, &manoeuvre.yaml(&name, platform, &[])) {
                Ok(motion) => motion,
                Err(reason) => return Either::Right((name, format!("cannot be simulated: {reason}"))),
            };
            let demand = ManoeuvreDemand::of(&motion, case.model);
            let Some(objection) = demand.objection() else {
                let expected = ExpectedInformation::default();
                return Either::Left(Judged { manoeuvre, demand, expected, motion });
            };
            beyond = (name, objection);
        }
        Either::Right(beyond)
    };
    let all = 0..family(case.model, 1.0).len();
    let (mut judged, left_out): (Vec<Judged>, Vec<_>) = all.into_par_iter().partition_map(rehearsed);
    if judged.is_empty() {
        let reasons: Vec<String> = left_out.iter().map(|(name, reason)| format!("{name} {reason}")).collect();
        return Err(ExplainError::Refused(format!("no manoeuvre can be proposed: {}", reasons.join("; "))));
    }
    say(0.5, "evaluating the manoeuvres");
    let further: Vec<Recording> = judged.iter().map(|judged| judged.motion.clone()).collect();
    let explanations = diagnosis.contenders();
    let (now, expected) =
        expected_information(case.training, &further, case.model, case.prior, &explanations, options)?;
    judged.iter_mut().zip(expected).for_each(|(judged, expected)| judged.expected = expected);
    let separates =
        matches!(diagnosis.verdict, Verdict::Confounded | Verdict::Named) && now.log_odds.is_some();
    let worth = |j: &Judged| {
        let odds = (STEPS * (j.expected.log_odds.unwrap_or(0.0) / DECIDED).clamp(0.0, 1.0)).round();
        let (shown, short) = (j.expected.shown.len() as f64, -j.demand.duration_s);
        if separates { [odds, short, shown] } else { [shown, odds, short] }
    };
    judged.sort_by(|a, b| worth(b).partial_cmp(&worth(a)).unwrap_or(std::cmp::Ordering::Equal));
    Ok(Proposal { explanations, now, judged, left_out, separates })
}

/// Whether anything is in doubt that a further run may decide.
pub fn needs_run(verdict: Verdict) -> bool {
    !matches!(verdict, Verdict::Named | Verdict::NothingMissing)
}

impl Proposal {
    /// The proposal, the reasons, and the demands on the platform.
    pub fn answer(&self, best: &Judged, verdict: Verdict, platform: &str) -> Vec<String> {
        let one = |id: &String| find(id).map_or_else(|| id.clone(), |e| format!("{} ({id})", e.info().title));
        let of_set = |set: &Vec<String>| match set[..] {
            [] => "the current model".to_owned(),
            _ => set.iter().map(one).collect::<Vec<_>>().join(" with "),
        };
        let sets: Vec<String> = self.explanations.iter().map(of_set).collect();
        let shown = |of: &ExpectedInformation| {
            let all = of.shown.len() + of.not_shown.len();
            format!("{} of {all} effects would show at their ordinary size", of.shown.len())
        };
        let (lead, why) = match verdict {
            Verdict::Confounded => ("The data leave open: ", sets.join("; or ")),
            Verdict::Named => ("No run is needed: the data name ", sets.first().cloned().unwrap_or_default()),
            Verdict::Unknown => ("Something is missing that no effect explains: ", shown(&self.now)),
            Verdict::NothingMissing => ("No run is needed: nothing is missing, and ", shown(&self.now)),
            Verdict::NotEnoughInformation => ("The data cannot say what is missing: only ", shown(&self.now)),
        };
        let next = if needs_run(verdict) { "Next" } else { "If you make one all the same" };
        let odds = best.expected.log_odds.unwrap_or(0.0);
        let decides = if odds >= DECIDED { "decides" } else { "does not decide" };
        let worth = if self.separates {
            format!("Whichever is true, it is expected to lead by {odds:.1} in log odds, which {decides}.")
        } else {
            format!("With it {}.", shown(&best.expected))
        };
        let ManoeuvreDemand { duration_s, tilt_deg, tilt_limit_deg, rate_deg_s, .. } = best.demand;
        let [wheels, gas] = [best.demand.wheel_speed_share, best.demand.gas_share].map(|share| 100.0 * share);
        vec![
            format!("{lead}{why}."),
            format!("{next}: {platform} {} ({}).", best.manoeuvre.words, best.manoeuvre.name),
            worth,
            format!(
                "In simulation it takes {duration_s:.0} s, tilts by up to {tilt_deg:.1} of {tilt_limit_deg:.1} deg, turns at up to \
                 {rate_deg_s:.1} deg/s, brings the wheels to {wheels:.0} % of their speed, and uses {gas:.1} % of a full tank."
            ),
        ]
    }
}
