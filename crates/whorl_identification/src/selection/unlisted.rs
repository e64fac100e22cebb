//! Unlisted laws: explanations outside the catalogue that compete with its effects.
//!
//! Torques of simple shape (a function of one recorded variable, about one axis of the body or of the room) and errors of sensors are
//! columns of the causal filter beside the parameters of a set ([`whorl_prediction::hints`]), with the slow random torque and the noise
//! that the samples show. Each is evaluated by the same evidence as the catalogue's effects, with a log-prior penalty for the number of
//! laws that were tried. This is the regression of a random-walk torque on the recorded channels (Kristensen et al. 2004), without smoothing the
//! torque first.

use nalgebra::{DVector, Vector3};
use whorl_dynamics::PlatformModel;
use whorl_prediction::{
    Disturbance, Followed, Laws, PredictionError, Prepared, Push, RandomTorque, followed_with, hints,
};
use whorl_recording::Recording;

use crate::fitting::normal_equations::{Estimate, Normal};
use crate::grammar::SIZES;
use crate::grammar::unlisted::{At, Column, Law, Shape, columns_of, laws, push, shapes};
use crate::grammar::variable::Variable;
use crate::selection::hypothesis::{Evaluated, Runs};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Observed};
use crate::verdict::diagnosis::Unknown;
use crate::{DiagnosisError, threads};

/// Random torque that any rig has, over that which is no background any more. An assumption: a tenth of its variance.
const BACKGROUND: f64 = 0.3;
/// Its correlation times \[s\]: those of draughts and of floors that tilt, two of the predictor's.
const BACKGROUND_S: [f64; 2] = [3.0, 30.0];

/// Laws beside a set that are kept, likeliest first.
const MOST_LAWS: usize = 12;

/// An unlisted law beside a set of effects.
#[derive(Debug, Clone)]
pub(crate) struct Unlisted {
    pub unknown: Unknown,
    /// Log evidence of the law and the set together over that of the set, its prior included.
    pub gain: f64,
}

/// Laws of all runs.
struct Tried {
    variables: Vec<Variable>,
    groups: Vec<Vec<Shape>>,
    columns: Vec<Column>,
    laws: Vec<Law>,
}

/// Laws beside a set, likeliest first.
pub(crate) fn laws_beside(
    runs: &Runs<'_>,
    set: &Evaluated,
    observed: &[Observed<'_>],
    lines: &Lines,
) -> Result<Vec<Unlisted>, DiagnosisError> {
    let reference = runs.reference;
    let settings = &reference.settings;
    let refit = set.refit(reference);
    let Some(model) = refit.model_at(&set.fitted.at) else { return Ok(Vec::new()) };
    let applied = Applied::of(observed, &model, settings.at_work_s);
    let (variables, groups) = shapes(observed, &model, lines);
    let columns = columns_of(&groups);
    let tried = Tried { laws: laws(&groups, &columns), variables, groups, columns };
    let Some(normal) = DiagnosisError::possible(normal_of(runs, set, &tried, observed, &applied))? else {
        return Ok(Vec::new());
    };
    let own: Vec<usize> = (0..set.columns.len()).collect();
    let known = |i: usize| set.stddevs.get(i).map(|stddev| stddev.powi(2));
    let Some(without) = Estimate::new(&normal, &own, |i| known(i).unwrap_or(1.0)) else {
        return Ok(Vec::new());
    };
    let log_prior_of_law = settings.unmodelled.ln() - ((tried.laws.len() * SIZES.len()) as f64).ln();
    let scored = threads::map(runs.threads, &tried.laws, |law| beside(&normal, &own, law, &known));
    // What a slow random torque explains instead.
    let excess = 2.0 * set.fitted.followed.iter().map(|run| run.gain_nats.max(0.0)).sum::<f64>();
    let mut found = Vec::new();
    for (law, with) in tried.laws.iter().zip(&scored) {
        let Some(with) = with else { continue };
        let Some(shape) = tried.groups.get(law.group).and_then(|g| g.first()) else { continue };
        let drop = with.drop - without.drop;
        // A frequency that was read off the spectrum of these data may have been at any other frequency.
        let picked = if shape.is_picked { lines.frequencies.ln() } else { 0.0 };
        let gain = with.log_evidence - without.log_evidence + log_prior_of_law - picked;
        if gain < settings.worth_mentioning.ln() {
            continue;
        }
        // Of a law about several axes, the axis about which it explains most.
        let axis = law.axis.or_else(|| strongest_axis(law, &tried.laws, &scored));
        found.push(Unlisted {
            gain,
            unknown: Unknown {
                variable: shape.variable.clone(),
                frame: if law.world { "world" } else { "body" }.to_owned(),
                axis: ["x", "y", "z"].get(axis.unwrap_or(2)).copied().unwrap_or("z").to_owned(),
                parity: shape.parity.to_owned(),
                frequency_hz: shape.frequency_hz,
                share: (drop / excess.max(drop)).clamp(0.0, 1.0),
                size: tried.size_of(law, &with.value, own.len(), observed, &model, &applied),
                unit: shape.unit().to_owned(),
            },
        });
    }
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    found.truncate(MOST_LAWS);
    Ok(found)
}

/// The normal equations of the samples for the columns of a set and of all laws, those of the set first.
fn normal_of(
    runs: &Runs<'_>,
    set: &Evaluated,
    tried: &Tried,
    observed: &[Observed<'_>],
    applied: &Applied,
) -> Result<Normal, DiagnosisError> {
    // Laws are tried one at a time: products of the columns of different laws are not needed.
    let span = |law: &Law| Some(law.columns.iter().max()? - law.columns.iter().min()? + 1);
    let apart = tried.laws.iter().filter_map(span).max().unwrap_or(0);
    let with_angles = tried.groups.iter().flatten().any(|shape| shape.variable.ends_with("_angle"));
    let of_run = |run| {
        Laws::new(tried.columns.len(), apart, move |plant, pushes| {
            let here = At::plant(&tried.variables, run, plant, with_angles);
            let all = tried.columns.iter();
            pushes.extend(all.map(|column| push(&tried.groups, column, &here, applied)));
        })
    };
    let of_runs: Vec<Laws<'_>> = observed.iter().map(of_run).collect();
    let refit = set.refit(runs.reference);
    let (parameters, at) = (refit.parameters(), &set.fitted.at);
    let model_at = |units: &[f64]| refit.model_at(units);
    let followed = on_background(runs, set, applied)?;
    let found = hints(runs.training, &parameters, &model_at, at, &followed, &of_runs, &runs.prediction())?;
    Ok(Normal::about(&found, at, &parameters))
}

/// The runs of a set with a random torque in each: where it needs none, with a background that any rig may have. A law without a name must
/// explain more than that.
fn on_background(
    runs: &Runs<'_>,
    set: &Evaluated,
    applied: &Applied,
) -> Result<Vec<Followed>, DiagnosisError> {
    let settings = &runs.reference.settings;
    let stddev_n_m = BACKGROUND * settings.background_share * applied.body_n_m();
    let model = set.refit(runs.reference).model_at(&set.fitted.at).ok_or(PredictionError::NoModel)?;
    let of_run = |(recording, followed): (&Recording, &Followed)| -> Result<Followed, DiagnosisError> {
        let case = Prepared::new(recording, &model, runs.prediction())?;
        if followed.noise.disturbance.is_some() || case.is_clamped() {
            return Ok(followed.clone());
        }
        let of_time = |correlation_s| RandomTorque { stddev_b_n_m: [stddev_n_m; 3], correlation_s };
        let disturbance =
            Disturbance { body: BACKGROUND_S.map(of_time).to_vec(), ..followed.noise.disturbance.clone() };
        Ok(followed_with(&case, followed, disturbance))
    };
    runs.training.iter().zip(&set.fitted.followed).map(of_run).collect()
}

impl Tried {
    /// Root mean square of what a law adds, over all instants of all runs, in its own unit.
    fn size_of(
        &self,
        law: &Law,
        value: &DVector<f64>,
        first: usize,
        observed: &[Observed<'_>],
        model: &PlatformModel,
        applied: &Applied,
    ) -> f64 {
        // The columns of a law come after those of the set, in the order of the law.
        let columns = law.columns.iter().enumerate();
        let terms: Vec<(&Column, f64)> = columns
            .filter_map(|(place, column)| Some((self.columns.get(*column)?, *value.get(first + place)?)))
            .collect();
        let (mut square, mut count) = (0.0, 0.0);
        for run in observed {
            for k in 0..run.motion.time_s.len() {
                let here = At::motion(&self.variables, run, model, k);
                let added =
                    |(column, amount): &(&Column, f64)| match push(&self.groups, column, &here, applied) {
                        Push::Body(v) | Push::Gyro(v) | Push::Turn(v) => v * *amount,
                        Push::Wheel(_, torque_n_m) => Vector3::x() * (torque_n_m * amount),
                    };
                square += terms.iter().map(added).sum::<Vector3<f64>>().norm_squared();
                count += 1.0;
            }
        }
        (square / f64::max(count, 1.0)).sqrt()
    }
}

/// A regression with the columns of a law behind its `own`, at the likeliest of the prior sizes; `known`: variances of its own columns.
fn beside(
    normal: &Normal,
    own: &[usize],
    law: &Law,
    known: &(impl Fn(usize) -> Option<f64> + Sync),
) -> Option<Estimate> {
    let all: Vec<usize> = own.iter().copied().chain(law.columns.iter().map(|c| own.len() + c)).collect();
    let with = |size: f64| Estimate::new(normal, &all, |i| known(i).unwrap_or(size * size));
    let found = SIZES.iter().filter_map(|size| with(*size));
    found.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// The axis about which a law explains most of what it does about several.
fn strongest_axis(law: &Law, laws: &[Law], scored: &[Option<Estimate>]) -> Option<usize> {
    let about = laws
        .iter()
        .zip(scored)
        .filter(|(other, _)| other.axis.is_some() && (other.group, other.world) == (law.group, law.world));
    let drop = |found: &Option<Estimate>| found.as_ref().map_or(0.0, |e| e.drop);
    about.max_by(|a, b| drop(a.1).total_cmp(&drop(b.1))).and_then(|(other, _)| other.axis)
}
