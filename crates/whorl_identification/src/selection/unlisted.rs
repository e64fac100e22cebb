//! Unlisted laws: explanations outside the catalogue that compete with its effects.
//!
//! Torques of simple shape and errors of sensors are columns of the causal filter beside the parameters of a set, with the slow random torque and
//! noise that the samples show, by the same evidence as the catalogue's effects, less the logarithm of the number of laws: the regression of a
//! random-walk torque on the recorded channels (Kristensen et al. 2004), without smoothing it first.

use nalgebra::Vector3;
use whorl_dynamics::PlatformModel;
use whorl_math::normal_equations::Estimate;
use whorl_math::threads;
use whorl_prediction::{Disturbance, Followed, Laws, Prepared, Push, RandomTorque, followed_with, hints};
use whorl_recording::Recording;

use crate::fitting::refit::about;
use crate::grammar::{At, Grammar, Law, SIZES, of_diagnosis};
use crate::selection::hypothesis::{Evaluated, Runs};
use crate::signals::lines::Lines;
use crate::signals::observed::{Applied, Observed};
use crate::verdict::diagnosis::Unknown;
use crate::{DiagnosisError, Outcome};

/// Random torque that any rig has, over that which is no background any more. An assumption: a tenth of its variance.
const BACKGROUND: f64 = 0.3;
/// Its correlation times \[s\]: those of draughts and of floors that tilt, two of the predictor's.
const BACKGROUND_S: [f64; 2] = [3.0, 30.0];
/// Laws beside a set that are kept, likeliest first.
const MOST_LAWS: usize = 12;

/// What columns of laws bring beside a set.
pub(crate) struct Found {
    /// Log evidence over that of the set alone, at the likeliest of the prior sizes.
    pub gain: f64,
    /// Drop of twice the negative log posterior.
    drop: f64,
    pub values: Vec<f64>,
}

/// A set, the runs as it leaves them, and what is periodic in that.
#[derive(Clone, Copy)]
pub(crate) struct Left<'s, 'a> {
    pub set: &'s Evaluated,
    pub observed: &'s [Observed<'a>],
    pub lines: &'s Lines,
}

/// Laws beside a set, likeliest first, each with the log evidence of it and the set together over that of the set, its prior included.
pub(crate) fn laws_beside(runs: &Runs<'_>, left: Left<'_, '_>) -> Outcome<Vec<(Unknown, f64)>> {
    let Left { set, observed, lines } = left;
    let (settings, model) = (&runs.reference.settings, set.model(runs.reference)?);
    let applied = Applied::of(observed, &model, settings.at_work_s);
    let grammar = of_diagnosis(observed, &model, lines);
    let found = scored((runs, set, observed), &grammar, &applied);
    let Some(scored) = DiagnosisError::possible(found)? else { return Ok(Vec::new()) };
    let log_prior_of_law = settings.unmodelled.ln() - (grammar.laws.len() as f64).ln();
    // What a slow random torque explains instead.
    let excess = 2.0 * set.fitted.followed.iter().map(|run| run.gain_nats.max(0.0)).sum::<f64>();
    let unlisted = |(law, found): (&Law, &Option<Found>)| {
        let (found, term) = (found.as_ref()?, grammar.term(law));
        // A frequency that was read off the spectrum of these data may have been at any other frequency.
        let picked = term.frequency_hz.map_or(0.0, |_| lines.frequencies.ln());
        let gain = found.gain + log_prior_of_law - picked;
        // Of a law about several axes, the axis about which it explains most.
        let axis = law.axis.unwrap_or_else(|| strongest_axis(&grammar, law, &found.values));
        let unknown = || Unknown {
            variable: term.variable.clone(),
            frame: if law.world { "world" } else { "body" }.to_owned(),
            axis: ["x", "y", "z"][axis].to_owned(),
            parity: format!("{:?}", term.parity).to_lowercase(),
            frequency_hz: term.frequency_hz,
            share: (found.drop / excess.max(found.drop)).clamp(0.0, 1.0),
            size: size_of(&grammar, law, &found.values, observed, &model, &applied),
            unit: term.way.unit().to_owned(),
        };
        (gain >= settings.worth_mentioning.ln()).then(|| (unknown(), gain))
    };
    let mut all: Vec<(Unknown, f64)> = grammar.laws.iter().zip(&scored).filter_map(unlisted).collect();
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all.truncate(MOST_LAWS);
    Ok(all)
}

/// What each law of a grammar brings beside a set of effects; `None` for one that the data do not determine.
pub(crate) fn scored(
    (runs, set, observed): (&Runs<'_>, &Evaluated, &[Observed<'_>]),
    grammar: &Grammar,
    applied: &Applied,
) -> Outcome<Vec<Option<Found>>> {
    let of_run = |run| {
        Laws::new(grammar.columns.len(), grammar.apart, move |plant, pushes| {
            let here = At::new(&grammar.quantities, run, plant.environment());
            pushes.extend(grammar.columns.iter().map(|column| grammar.push(column, &here, applied)));
        })
    };
    let of_runs: Vec<Laws<'_>> = observed.iter().map(of_run).collect();
    let refit = set.refit(runs.reference);
    let (parameters, at, own) = (refit.parameters(), &set.fitted.at, set.columns.len());
    let model_at = |units: &[f64]| refit.model_at(units);
    let followed = on_background(runs, set, applied)?;
    let found = hints(runs.training, &parameters, &model_at, at, &followed, &of_runs, &runs.prediction())?;
    let normal = about(&found, at, &parameters);
    // Columns behind those of the set.
    let beside = |columns: &[usize], size: f64| {
        let all: Vec<usize> = (0..own).chain(columns.iter().map(|column| own + column)).collect();
        Estimate::new(&normal, &all, |i| set.stddevs.get(i).map_or(size, |stddev| *stddev).powi(2))
    };
    let Some(without) = beside(&[], 1.0) else { return Ok(Vec::new()) };
    let of_law = |law: &Law| {
        let of_sizes = SIZES.iter().filter_map(|size| beside(&law.columns, *size));
        let with = of_sizes.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        Some(Found {
            gain: with.log_evidence - without.log_evidence - (SIZES.len() as f64).ln(),
            drop: with.drop - without.drop,
            values: law.columns.iter().map(|column| with.of(own + column)).collect(),
        })
    };
    Ok(threads::map(runs.threads, &grammar.laws, of_law))
}

/// The runs of a set with a random torque in each: where it needs none, a background that any rig may have. Laws must explain more than that.
fn on_background(runs: &Runs<'_>, set: &Evaluated, applied: &Applied) -> Outcome<Vec<Followed>> {
    let model = set.model(runs.reference)?;
    let stddev_n_m = BACKGROUND * runs.reference.settings.background_share * applied.body_n_m();
    let of_run = |(recording, followed): (&Recording, &Followed)| -> Outcome<Followed> {
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

/// Root mean square of what a law adds with these values, over all instants of all runs, in its own unit.
fn size_of(
    grammar: &Grammar,
    law: &Law,
    values: &[f64],
    observed: &[Observed<'_>],
    model: &PlatformModel,
    applied: &Applied,
) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for run in observed {
        for state in &run.motion.states {
            let here = At::motion(&grammar.quantities, run, model, state);
            let added = |(column, value): (&usize, &f64)| {
                *value
                    * match grammar.push(&grammar.columns[*column], &here, applied) {
                        Push::Body(v) | Push::Gyro(v) | Push::Turn(v) => v,
                        Push::Wheel(_, torque_n_m) => Vector3::x() * torque_n_m,
                    }
            };
            square += law.columns.iter().zip(values).map(added).sum::<Vector3<f64>>().norm_squared();
            count += 1.0;
        }
    }
    (square / f64::max(count, 1.0)).sqrt()
}

/// The axis about which a law does most of what it does about several; the last of one that has a single axis of its own.
fn strongest_axis(grammar: &Grammar, law: &Law, values: &[f64]) -> usize {
    let mut squares = [0.0; 3];
    for (column, value) in law.columns.iter().zip(values) {
        squares[grammar.columns[*column].axis] += value * value;
    }
    let about_several = (0..3).filter(|_| squares[1..] != [0.0; 2]);
    about_several.max_by(|a, b| squares[*a].total_cmp(&squares[*b])).unwrap_or(2)
}
