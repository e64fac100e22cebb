//! What drives a torque that no effect of the catalogue explains.
//!
//! Torques of simple shape (a function of one recorded variable, about one axis of the body or of the room)
//! pass through the whitening filter like any effect; the one that explains most names variable, frame,
//! axis and parity. This is the regression of a random-walk torque on the recorded channels (Kristensen et
//! al. 2004), without smoothing the torque first.

use crate::columns::stray_response;
use crate::diagnosis::Unknown;
use crate::regression::{Estimate, Normal, Whitened};
use crate::search::Search;
use crate::shapes::{Column, columns_of, laws, of_sensors, shapes, stray};
use crate::threads;
use crate::wander::Wander;

/// The torque of simple shape that explains most of what is left, and how well.
#[derive(Debug, Clone)]
pub(crate) struct Follower {
    pub unknown: Unknown,
    /// Log evidence that it adds to the best set of effects, choices paid for.
    pub added_evidence: f64,
    /// Drop of the misfit that it adds to the best set.
    pub added_drop: f64,
    /// Log evidence of the best shape beside the base model alone, choices paid for.
    pub alone_evidence: f64,
}

/// Log evidence and drop of the misfit, beside the best set and beside the base model.
type Score = ((f64, f64), (f64, f64));

/// Finds the shape that explains most of what the best set of effects leaves; only among those of sensors, or
/// among all.
pub(crate) fn describe(search: &Search<'_>, only_sensors: bool) -> Option<Follower> {
    let groups = if only_sensors { of_sensors() } else { shapes(search) };
    let linearised = search.problem.linearise(&search.point).ok()?;
    // Columns of their own regression beside the base.
    let columns = columns_of(&groups);
    let laws = laws(&groups, &columns);
    let base = &search.best.estimate.active;
    let variances = search.best.variances(&search.layout);
    let base_size = search.layout.base.len();
    let lanes = crate::columns::LANES;
    let chunks: Vec<&[Column]> = columns.chunks(crate::columns::GROUPS * lanes).collect();
    let work: Vec<(usize, usize)> =
        (0..search.problem.runs.len()).flat_map(|r| (0..chunks.len()).map(move |c| (r, c))).collect();
    let responses = threads::map(search.problem.threads, &work, |&(r, c)| {
        let (Some(run), Some(motion), Some(linear), Some(chunk)) =
            (search.problem.runs.get(r), search.problem.motions.get(r), linearised.get(r), chunks.get(c))
        else {
            return Vec::new();
        };
        let strays: Vec<_> = chunk.iter().map(|column| stray(&groups, column, run, motion)).collect();
        stray_response(run, linear, &strays)
    });
    let mut whitened: Vec<Whitened> = search
        .data
        .whitened
        .iter()
        .map(|w| Whitened {
            groups: Vec::new(),
            y: Vec::new(),
            reading: w.reading.clone(),
            node: w.node.clone(),
            nodes: w.nodes,
        })
        .collect();
    for ((r, _), response) in work.iter().zip(responses) {
        whitened.get_mut(*r)?.groups.extend(response);
    }
    let total = columns.len();
    // Cross products with the base's columns, run by run.
    let mut joint = Normal::zeros(base.len() + total);
    for (run_index, slot) in whitened.iter_mut().enumerate() {
        slot.y = vec![0.0; slot.reading.len()];
        slot.colour(search.data.colours.get(run_index)?, search.problem.threads);
        let old = search.data.whitened.get(run_index)?;
        let mut combined = Whitened {
            groups: old.selected(base),
            y: old.y.clone(),
            reading: slot.reading.clone(),
            node: slot.node.clone(),
            nodes: slot.nodes,
        };
        let padded = combined.groups.len() * lanes;
        combined.groups.append(&mut slot.groups);
        for block in combined.normals(padded + total.next_multiple_of(lanes), search.problem.threads, 1) {
            let index = |i: usize| if i < base.len() { i } else { padded + i - base.len() };
            for i in 0..base.len() + total {
                joint.vector[i] += block.vector[index(i)];
                for j in 0..base.len() + total {
                    joint.matrix[(i, j)] += block.matrix[(index(i), index(j))];
                }
            }
        }
    }
    let variance =
        |i: usize| base.get(i).map_or(100.0, |b| variances.get(*b).copied().unwrap_or(1.0).max(1e-12));
    let own: Vec<usize> = (0..base.len()).collect();
    // The base model's columns come first among those of every fit.
    let bare: Vec<usize> = (0..base_size.min(base.len())).collect();
    let bare_variance = |i: usize| match base.get(i) {
        Some(b) => search.layout.base_variance(*b).max(1e-12),
        None => 100.0,
    };
    let without = Estimate::new(&joint, &own, variance)?;
    let bare_without = Estimate::new(&joint, &bare, bare_variance)?;
    let scored = threads::map(search.problem.threads, &laws, |law| {
        let with = |known: &[usize], variance: &dyn Fn(usize) -> f64, without: &Estimate| {
            let active: Vec<usize> =
                known.iter().copied().chain(law.columns.iter().map(|c| base.len() + c)).collect();
            Estimate::new(&joint, &active, variance).map_or((0.0, 0.0), |with| {
                (with.log_evidence - without.log_evidence, with.drop - without.drop)
            })
        };
        (with(&own, &variance, &without), with(&bare, &bare_variance, &bare_without))
    });
    let choices = (laws.len() as f64).ln();
    let alone_evidence = scored.iter().map(|s| s.1.0).fold(f64::NEG_INFINITY, f64::max) - choices;
    let best_by = |score: &dyn Fn(&Score) -> f64| {
        laws.iter().zip(&scored).max_by(|a, b| score(a.1).total_cmp(&score(b.1)))
    };
    let (mut best, (added, _)) = best_by(&|s| s.0.0)?;
    // Where a shape alone outdoes every name, it says more than what it adds to the names.
    let explained = search.best.log_evidence - search.base.log_evidence;
    let by_alone = alone_evidence > explained;
    if by_alone {
        best = best_by(&|s| s.1.0)?.0;
    }
    let shape = groups.get(best.group)?.first()?;
    // Of a torque about several axes, the axis about which it explains most.
    let axis = best.axis.or_else(|| {
        let about = laws
            .iter()
            .zip(&scored)
            .filter(|(law, _)| law.axis.is_some() && (law.group, law.world) == (best.group, best.world));
        let drop = |s: &Score| if by_alone { s.1.1 } else { s.0.1 };
        about.max_by(|a, b| drop(a.1).total_cmp(&drop(b.1))).and_then(|(law, _)| law.axis)
    });
    let mut follower = Follower {
        unknown: Unknown {
            variable: shape.variable.clone(),
            frame: if best.world { "world" } else { "body" }.to_owned(),
            axis: axis_name(axis.unwrap_or(2)).to_owned(),
            parity: shape.parity.to_owned(),
            frequency_hz: shape.frequency_hz,
            share: 0.0,
        },
        added_evidence: added.0 - choices,
        added_drop: added.1,
        alone_evidence,
    };
    if let Some(wander) = if only_sensors { None } else { crate::wander::wander(search) } {
        follower.or_wander(&wander, explained);
    }
    let left = (search.data.total.sum_of_squares - search.base.estimate.drop - search.data.total.rows)
        .max(follower.added_drop + search.best.estimate.drop - search.base.estimate.drop);
    follower.unknown.share = (follower.added_drop / left.max(1.0)).clamp(0.0, 1.0);
    Some(follower)
}

impl Follower {
    /// A torque that is free in time, where that explains more than any shape.
    fn or_wander(&mut self, wander: &Wander, explained: f64) {
        let is_alone = self.alone_evidence.max(wander.alone_evidence) > explained;
        let is_better = if is_alone {
            wander.alone_evidence > self.alone_evidence
        } else {
            wander.added_evidence > self.added_evidence
        };
        if is_better {
            self.unknown = Unknown {
                variable: "time".to_owned(),
                frame: if wander.world { "world" } else { "body" }.to_owned(),
                axis: axis_name(wander.axis).to_owned(),
                parity: "none".to_owned(),
                frequency_hz: None,
                share: 0.0,
            };
        }
        if wander.added_evidence > self.added_evidence {
            (self.added_evidence, self.added_drop) = (wander.added_evidence, wander.added_drop);
        }
        self.alone_evidence = self.alone_evidence.max(wander.alone_evidence);
    }
}

fn axis_name(axis: usize) -> &'static str {
    ["x", "y", "z"].get(axis).copied().unwrap_or("z")
}
