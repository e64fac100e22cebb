//! Unmodelled laws: explanations outside the catalogue that compete with its effects.
//!
//! Torques of simple shape (a function of one recorded variable, about one axis of the body or of the room) and errors of sensors are
//! columns of the causal filter beside the parameters of a set ([`whorl_prediction::hints`]), with the slow random torque and the noise
//! that the samples show. Each is evaluated by the same evidence as the catalogue's effects, with a log-prior penalty for the number of
//! laws that were tried. This is the regression of a random-walk torque on the recorded channels (Kristensen et al. 2004), without smoothing the
//! torque first.

use nalgebra::{DVector, Vector3};
use whorl_prediction::{Laws, Push};
use whorl_recording::Recording;

use crate::DiagnosisError;
use crate::diagnosis::Unknown;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::shapes::{At, Column, Law, Shape, columns_of, laws, push, shapes};
use crate::search::Search;
use crate::search::score::{Converged, JudgedFit};

/// Prior sizes that are tried, in units of a law's columns.
const SIZES: [f64; 4] = [0.3, 3.0, 30.0, 300.0];

/// An unmodelled law beside a set of effects.
#[derive(Debug, Clone)]
pub(crate) struct Unmodelled {
    /// Effects beside which it stands.
    pub beside: Vec<String>,
    pub unknown: Unknown,
    /// Log evidence of the law and the set together, its prior included.
    pub log_evidence: f64,
}

/// Laws of all runs.
struct Tried {
    groups: Vec<Vec<Shape>>,
    columns: Vec<Column>,
    laws: Vec<Law>,
}

impl Search<'_> {
    /// Laws beside a set that was fitted to the samples, likeliest first; none where no filter can be run.
    pub(crate) fn laws_beside(
        &self,
        at: &Converged,
        training: &[Recording],
    ) -> Result<Vec<Unmodelled>, DiagnosisError> {
        let Some(fit) = at.judged.as_ref().map(|judged| &judged.fit) else { return Ok(Vec::new()) };
        let groups = shapes(self.place());
        let columns = columns_of(&groups);
        let tried = Tried { laws: laws(&groups, &columns), groups, columns };
        let Some(normal) = DiagnosisError::possible(self.normal_of(at, fit, &tried, training))? else {
            return Ok(Vec::new());
        };
        let own: Vec<usize> = (0..fit.columns.len()).collect();
        let known = |i: usize| fit.stddevs.get(i).map(|stddev| stddev.powi(2));
        let Some(without) = Estimate::new(&normal, &own, |i| known(i).unwrap_or(1.0)) else {
            return Ok(Vec::new());
        };
        let settings = &self.options.settings;
        let log_prior_of_law = settings.unmodelled.ln() - ((tried.laws.len() * SIZES.len()) as f64).ln();
        let with = |law: &Law| beside(&normal, &own, law, &known);
        let scored = crate::threads::map(self.problem.threads, &tried.laws, with);
        // What a slow random torque explains instead.
        let excess = 2.0 * fit.fitted.followed.iter().map(|run| run.gain_nats.max(0.0)).sum::<f64>();
        let mut found = Vec::new();
        for (law, with) in tried.laws.iter().zip(&scored) {
            let Some(with) = with else { continue };
            let Some(shape) = tried.groups.get(law.group).and_then(|g| g.first()) else { continue };
            let drop = with.drop - without.drop;
            // A frequency that was read off the spectrum of these data may have been at any other frequency.
            let picked = if shape.is_picked { self.problem.frequencies().ln() } else { 0.0 };
            let gain = with.log_evidence - without.log_evidence + log_prior_of_law - picked;
            if gain < settings.worth_mentioning.ln() {
                continue;
            }
            // Of a law about several axes, the axis about which it explains most.
            let axis = law.axis.or_else(|| strongest_axis(law, &tried.laws, &scored));
            found.push(Unmodelled {
                beside: at.names.clone(),
                log_evidence: at.score.log_evidence + gain,
                unknown: Unknown {
                    variable: shape.variable.clone(),
                    frame: if law.world { "world" } else { "body" }.to_owned(),
                    axis: ["x", "y", "z"].get(axis.unwrap_or(2)).copied().unwrap_or("z").to_owned(),
                    parity: shape.parity.to_owned(),
                    frequency_hz: shape.frequency_hz,
                    share: (drop / excess.max(drop)).clamp(0.0, 1.0),
                    size: self.size_of(&tried, law, &with.value, own.len()),
                    unit: shape.unit().to_owned(),
                },
            });
        }
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        Ok(found)
    }

    /// The normal equations of the samples for the columns of a set and of all laws, those of the set first.
    fn normal_of(
        &self,
        at: &Converged,
        fit: &JudgedFit,
        tried: &Tried,
        training: &[Recording],
    ) -> Result<Normal, DiagnosisError> {
        let problem = &self.problem;
        // Laws are tried one at a time: products of the columns of different laws are not needed.
        let span = |law: &Law| Some(law.columns.iter().max()? - law.columns.iter().min()? + 1);
        let apart = tried.laws.iter().filter_map(span).max().unwrap_or(0);
        let of_run = |(run, motion)| {
            Laws::new(tried.columns.len(), apart, move |plant, pushes| {
                let here = At::plant(run, motion, plant);
                let all = tried.columns.iter();
                pushes.extend(all.map(|column| push(&tried.groups, column, &here, &problem.torques)));
            })
        };
        let of_runs: Vec<Laws<'_>> = problem.runs.iter().zip(at.motions.iter()).map(of_run).collect();
        fit.normal(&fit.refit(&problem.reference), &of_runs, training, self.options.threads)
    }

    /// Root mean square of what a law adds, over all nodes of all runs, in its own unit.
    fn size_of(&self, tried: &Tried, law: &Law, value: &DVector<f64>, first: usize) -> f64 {
        let problem = &self.problem;
        // The columns of a law come after those of the set, in the order of the law.
        let columns = law.columns.iter().enumerate();
        let terms: Vec<(&Column, f64)> = columns
            .filter_map(|(place, column)| Some((tried.columns.get(*column)?, *value.get(first + place)?)))
            .collect();
        let (mut square, mut count) = (0.0, 0.0);
        for (run, motion) in problem.runs.iter().zip(problem.motions.iter()) {
            for node in 0..run.nodes() {
                let here = At::node(run, motion, &problem.reference.model, node);
                let added = |(column, amount): &(&Column, f64)| match push(
                    &tried.groups,
                    column,
                    &here,
                    &problem.torques,
                ) {
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
