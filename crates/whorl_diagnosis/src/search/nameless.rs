//! Laws that no effect of the catalogue has, as explanations that compete with those that have a name.
//!
//! Torques of simple shape (a function of one recorded variable, about one axis of the body or of the room) and errors of
//! sensors pass through the whitening filter like any effect; so does a torque about one axis that is free in time, as a
//! state of the filter. Each is weighed by the same evidence as the catalogue's effects, and pays for the number of laws
//! that were tried. This is the regression of a random-walk torque on the recorded channels (Kristensen et al. 2004),
//! without smoothing the torque first.

use std::sync::Arc;

use nalgebra::DVector;

use crate::DiagnosisError;
use crate::evidence::discrepancy::Discrepancy;
use crate::evidence::nuisance::Nuisance;
use crate::evidence::regression::{Estimate, Normal};
use crate::explanations::hypothesis::Hypothesis;
use crate::explanations::shapes::{Column, Law, Shape, columns_of, laws, shapes, stray};
use crate::search::Search;
use crate::search::climb::Sizes;

use crate::diagnosis::Unknown;
use crate::evidence::problem::{Dataset, Problem, Trust};
use crate::search::standing::Converged;
use crate::search::step::dataset;
use crate::threads;
use crate::whitening::columns::{LANES, Stray, stray_response};
use crate::whitening::filter::About;

/// Prior sizes that are tried, in units of a law's columns.
const SIZES: [f64; 4] = [0.3, 3.0, 30.0, 300.0];

/// Size of a free torque from which a climb to the likeliest begins, as steps: far below, its likelihood is flat.
const FIRST_STEPS: [u8; 2] = [4, 8];

/// A law without a name beside a set of effects.
#[derive(Debug, Clone)]
pub(crate) struct Nameless {
    /// Effects beside which it stands.
    pub beside: Vec<String>,
    pub unknown: Unknown,
    /// Log evidence of the law and the set together, its prior included.
    pub log_evidence: f64,
    /// Which of the laws it is; `None`: a torque that is free in time.
    pub law: Option<usize>,
    /// Log prior odds against no law, the choice among all that were tried included.
    pub log_prior: f64,
}

/// Normal equations of the columns of a set and of laws, those of the set first.
struct Joint {
    normal: Normal,
    /// Log density of the data where all innovations are zero.
    log_density: f64,
}

impl Search<'_> {
    /// Laws beside a set where it fits best, likeliest first.
    pub(crate) fn nameless_beside(&self, at: &Converged) -> Result<Vec<Nameless>, DiagnosisError> {
        // Beside a random torque that is no background, a law would be told by the little that it explains of it.
        let is_large = |torque: u8| self.problem.is_large(Nuisance { torque, ..at.standing.nuisance });
        let torque = (0..=at.standing.nuisance.torque).rev().find(|torque| !is_large(*torque)).unwrap_or(0);
        let mut found = self.laws_beside(at, Nuisance { torque, ..at.standing.nuisance })?;
        if torque > 0 {
            // A law that explains the torque leaves none for the noise.
            found.extend(self.laws_beside(at, Nuisance { torque: 0, ..at.standing.nuisance })?);
        }
        found.extend(self.free_torque_beside(at)?);
        found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        Ok(found)
    }

    /// The likeliest torque about one axis that is free in time.
    fn free_torque_beside(&self, at: &Converged) -> Result<Option<Nameless>, DiagnosisError> {
        let mut problem = self.problem.clone();
        problem.motions = Arc::clone(&at.motions);
        problem.nuisance = at.standing.nuisance;
        let starts: Vec<Nuisance> = (0..3)
            .flat_map(|axis| [About::Body(axis), About::World(axis)])
            .flat_map(|about| FIRST_STEPS.map(|torque| Nuisance { torque, about, ..at.standing.nuisance }))
            .collect();
        let (found, in_use) = problem.climb(&at.point, &starts, Sizes::Any)?;
        let is_one = found.sizes.torque > 0 && problem.is_large(found.sizes);
        let best = is_one.then_some((found.log_density - in_use, found.sizes));
        Ok(best.map(|(gain, likeliest)| {
            let background = problem.background(likeliest);
            let (frame, axis) = match likeliest.about {
                About::World(axis) => ("world", axis),
                About::Body(axis) => ("body", axis),
                About::All => ("body", 2),
            };
            Nameless {
                beside: at.names.clone(),
                log_evidence: at.standing.log_evidence + gain - 6f64.ln(),
                law: None,
                log_prior: -6f64.ln(),
                unknown: Unknown {
                    frame: frame.to_owned(),
                    axis: axis_name(usize::from(axis)).to_owned(),
                    share: 0.0,
                    ..Unknown::torque_in_time(background.stddev_n_m)
                },
            }
        }))
    }

    /// Laws of simple shape beside a set, with this noise.
    fn laws_beside(&self, at: &Converged, nuisance: Nuisance) -> Result<Vec<Nameless>, DiagnosisError> {
        let settings = &self.options.settings;
        let groups = shapes(self.place());
        let columns = columns_of(&groups);
        let laws = laws(&groups, &columns);
        let error = at.standing.relative_error;
        let mut problem = self.problem.clone();
        problem.motions = Arc::clone(&at.motions);
        problem.nuisance = nuisance;
        let training = dataset(&problem, &at.point, &at.layout, None)?;
        let Some(fit) = Hypothesis::free(&at.layout, &training.total, at.members.clone()) else {
            return Ok(Vec::new());
        };
        let active = fit.estimate.active.clone();
        let variances = fit.variances(&at.layout);
        let mut joint = joined(&problem, at, &training, &groups, &columns, &active, error)?;
        if let Some(held) = self.held_out.as_deref() {
            let mut held = held.clone();
            held.nuisance = nuisance;
            held.smooth(&at.point, Trust::AsDataSay)?;
            let data = dataset(&held, &at.point, &at.layout, None)?;
            let more = joined(&held, at, &data, &groups, &columns, &active, error)?;
            joint.normal.add(&more.normal, 1.0);
            joint.log_density += more.log_density;
        }
        let own: Vec<usize> = (0..active.len()).collect();
        let known = |i: usize| active.get(i).and_then(|c| variances.get(*c)).map(|v| v.max(1e-12));
        // What integrates out errors of formulas and the prices of choices are those of the set.
        let Some(without) = Estimate::new(&joint.normal, &own, |i| known(i).unwrap_or(1.0)) else {
            return Ok(Vec::new());
        };
        let choices = fit.log_evidence - fit.estimate.log_evidence;
        // Where the set has not come to its minimum, the regression promises more than there is.
        let mut values = DVector::zeros(joint.normal.vector.len());
        for (slot, column) in values.iter_mut().zip(active.iter().filter_map(|i| at.layout.columns.get(*i))) {
            *slot = problem.reference.distance(&at.point, column);
        }
        let penalty: f64 = own.iter().map(|i| values[*i].powi(2) / known(*i).unwrap_or(1.0)).sum();
        let at_point = joint.normal.misfit_at(&values) + penalty;
        let at_minimum = joint.normal.sum_of_squares - without.drop;
        // A point whose misfit is this near the minimum is at it.
        let near = 2.0 * settings.window_nats;
        let misfit = if at_point - at_minimum < near { at_minimum } else { at_point };
        let relinearised = without.log_evidence - 0.5 * without.drop - 0.5 * misfit
            + joint.log_density
            + choices
            + problem.log_prior(nuisance)
            - (settings.model_discrepancies.len() as f64).ln();
        // The set itself was weighed with its own noise.
        let alone = if nuisance == at.standing.nuisance { at.standing.log_evidence } else { relinearised };
        let price = settings.unmodelled.ln() - ((laws.len() * SIZES.len()) as f64).ln();
        let scored =
            threads::map(self.problem.threads, &laws, |law| beside(&joint.normal, &own, law, &known));
        let excess = (joint.normal.sum_of_squares - without.drop - joint.normal.rows).max(1.0);
        let mut found = Vec::new();
        for ((index, law), with) in laws.iter().enumerate().zip(&scored) {
            let Some(with) = with else { continue };
            let gain = with.log_evidence - without.log_evidence;
            let drop = with.drop - without.drop;
            let Some(shape) = groups.get(law.group).and_then(|g| g.first()) else { continue };
            // A rhythm that was read off the spectrum of these data may have been at any other frequency.
            let picked = if shape.is_picked { self.problem.frequencies().ln() } else { 0.0 };
            // Of a law about several axes, the axis about which it explains most.
            let axis = law.axis.or_else(|| strongest_axis(law, &laws, &scored));
            found.push(Nameless {
                beside: at.names.clone(),
                log_evidence: alone + gain + price - picked,
                law: Some(index),
                log_prior: price - picked,
                unknown: Unknown {
                    variable: shape.variable.clone(),
                    frame: if law.world { "world" } else { "body" }.to_owned(),
                    axis: axis_name(axis.unwrap_or(2)).to_owned(),
                    parity: shape.parity.to_owned(),
                    frequency_hz: shape.frequency_hz,
                    share: (drop / excess.max(drop)).clamp(0.0, 1.0),
                    size: size_of(&problem, &groups, &columns, law, &with.value, active.len()),
                    unit: shape.unit().to_owned(),
                },
            });
        }
        Ok(found)
    }
}

/// A regression with the columns of a law behind its `own`, at the likeliest of the prior sizes; `known`: variances of its own columns.
pub(crate) fn beside(
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

/// Root mean square of what a law adds, over all nodes of all runs, in its own unit.
fn size_of(
    problem: &Problem,
    groups: &[Vec<Shape>],
    columns: &[Column],
    law: &Law,
    value: &DVector<f64>,
    first: usize,
) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for (run, motion) in problem.runs.iter().zip(problem.motions.iter()) {
        let mut sum = vec![nalgebra::Vector3::zeros(); run.nodes()];
        for (place, column) in law.columns.iter().enumerate() {
            // The columns of a law come after those of the set, in the order of the law.
            let Some(amount) = value.get(first + place) else { continue };
            let Some(column) = columns.get(*column) else { continue };
            match stray(groups, column, run, motion, &problem.torques) {
                Stray::Torque(list) | Stray::Gyro(list) | Stray::Direction(list) => {
                    sum.iter_mut().zip(list).for_each(|(s, x)| *s += x * *amount);
                }
                Stray::Wheel(_, list) => {
                    sum.iter_mut().zip(list).for_each(|(s, x)| s.x += x * *amount);
                }
            }
        }
        square += sum.iter().map(nalgebra::Vector3::norm_squared).sum::<f64>();
        count += sum.len() as f64;
    }
    (square / f64::max(count, 1.0)).sqrt()
}

/// The regression of a set's columns and of all laws' columns, errors of the set's formulas integrated out.
fn joined(
    problem: &Problem,
    at: &Converged,
    data: &Dataset,
    groups: &[Vec<Shape>],
    columns: &[Column],
    active: &[usize],
    relative_error: f64,
) -> Result<Joint, DiagnosisError> {
    let linearised = problem.linearise(&at.point)?;
    let chunks: Vec<&[Column]> = columns.chunks(crate::whitening::columns::GROUPS * LANES).collect();
    let total = columns.len();
    let mut normal = Normal::zeros(active.len() + total);
    let mut log_density = data.log_density;
    // Of the columns that are in the regression.
    let mut signals = problem.signals(&at.point, &at.layout);
    for signal in &mut signals {
        let placed = signal.iter().filter_map(|(i, size)| Some((active.iter().position(|a| a == i)?, *size)));
        *signal = placed.collect();
    }
    for (r, (run, motion)) in problem.runs.iter().zip(problem.motions.iter()).enumerate() {
        let (Some(linear), Some(old)) = (linearised.get(r), data.whitened.get(r)) else { continue };
        let responses = threads::map(problem.threads, &chunks, |chunk| {
            let strays: Vec<_> =
                chunk.iter().map(|column| stray(groups, column, run, motion, &problem.torques)).collect();
            stray_response(run, linear, &strays)
        });
        let responses = responses.into_iter().flatten().collect();
        let colours = data.colours.get(r).map_or(&[][..], Vec::as_slice);
        let widened = old.widened(active, responses, total, colours, problem.threads);
        let combined = std::slice::from_ref(&widened.whitened);
        let (node_s, width) = ([run.node_s()], widened.width());
        let block_s = problem.reference.settings.model_discrepancy_s;
        let discrepancy = Discrepancy::new(combined, &node_s, &signals, width, block_s, problem.threads);
        let (of_run, gained) = discrepancy.integrated(&widened.normal(problem.threads), relative_error);
        log_density += gained;
        widened.add_unfilled(&of_run, &mut normal);
    }
    Ok(Joint { normal, log_density })
}

fn axis_name(axis: usize) -> &'static str {
    ["x", "y", "z"].get(axis).copied().unwrap_or("z")
}
