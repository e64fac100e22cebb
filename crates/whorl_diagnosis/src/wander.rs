//! Torques that come and go: what a torque free to follow time alone explains beside a set of effects.
//!
//! A named effect must explain the data in every part of them. A torque about one axis that may have any value
//! every few seconds, in each run its own, explains whatever slow torque a set of effects leaves, without a
//! guess of its cause. It pays for its freedom by its evidence, so where a name is right it adds nothing.

use nalgebra::Vector3;

use crate::columns::{GROUPS, LANES, Stray, stray_response};
use crate::regression::{Estimate, Normal, Whitened};
use crate::run::Run;
use crate::search::Search;
use crate::threads;

/// Time between the knots \[s\]: slower than the swings of the platform, faster than what people switch by hand.
const KNOT_S: f64 = 3.0;

/// Knots of each run at most: longer runs have them further apart.
const MOST_KNOTS: f64 = 40.0;

/// Torque of one column [N m].
const UNIT_N_M: f64 = 1e-3;

/// Sizes that are tried, in units of a column.
const SIZES: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];

/// What a torque free in time explains.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wander {
    /// It acts about an axis of the room, else of the body.
    pub world: bool,
    pub axis: usize,
    /// Log evidence that it adds to the best set of effects, choices paid for.
    pub added_evidence: f64,
    /// Drop of the misfit that it adds to the best set.
    pub added_drop: f64,
    /// Log evidence that it adds to the base model alone, choices paid for.
    pub alone_evidence: f64,
}

/// Time between knots and their number.
fn knots(run: &Run) -> (f64, usize) {
    let duration_s = run.time(run.nodes().saturating_sub(1)) - run.time(0);
    let count = (duration_s / KNOT_S).clamp(1.0, MOST_KNOTS).ceil();
    (duration_s / count, count as usize + 1)
}

/// Fits a torque of free course about every axis of both frames.
pub(crate) fn wander(search: &Search<'_>) -> Option<Wander> {
    let linearised = search.problem.linearise(&search.point).ok()?;
    let base = &search.best.estimate.active;
    let variances = search.best.variances(&search.layout);
    let base_size = search.layout.base.len().min(base.len());
    let runs = &search.problem.runs;
    let counts: Vec<usize> = runs.iter().map(|run| if run.clamped { 0 } else { knots(run).1 }).collect();
    let of_axis: usize = counts.iter().sum();
    let mut best: Option<Wander> = None;
    for world in [false, true] {
        let mut joint = Normal::zeros(base.len() + 3 * of_axis);
        let mut first = base.len();
        for (r, run) in runs.iter().enumerate() {
            let (motion, linear) = (search.problem.motions.get(r)?, linearised.get(r)?);
            let old = search.data.whitened.get(r)?;
            let (step_s, count) = (knots(run).0, *counts.get(r)?);
            let hats: Vec<(usize, usize)> =
                (0..3).flat_map(|axis| (0..count).map(move |k| (axis, k))).collect();
            let chunks: Vec<&[(usize, usize)]> = hats.chunks(GROUPS * LANES).collect();
            let groups = threads::map(search.problem.threads, &chunks, |chunk| {
                let torques: Vec<Stray> = chunk
                    .iter()
                    .map(|(axis, knot)| {
                        let mut unit = Vector3::zeros();
                        unit[*axis] = UNIT_N_M;
                        let torque = (0..run.nodes())
                            .map(|k| {
                                let at = (run.time(k) - run.time(0)) / step_s;
                                let size = (1.0 - (at - *knot as f64).abs()).max(0.0);
                                match motion.q.get(k) {
                                    Some(q) if world => q.inverse_transform_vector(&unit) * size,
                                    _ => unit * size,
                                }
                            })
                            .collect();
                        Stray::Torque(torque)
                    })
                    .collect();
                stray_response(run, linear, &torques)
            });
            let mut slot = Whitened {
                groups: groups.into_iter().flatten().collect(),
                y: vec![0.0; old.y.len()],
                reading: old.reading.clone(),
                node: old.node.clone(),
                nodes: old.nodes,
            };
            slot.colour(search.data.colours.get(r)?, search.problem.threads);
            let mut groups = old.selected(base);
            let padded = groups.len() * LANES;
            groups.append(&mut slot.groups);
            let combined = Whitened { groups, y: old.y.clone(), ..slot };
            let place = |i: usize| if i < base.len() { i } else { padded + i - base.len() };
            // Axis by axis, run by run in each.
            let target = |i: usize| match i.checked_sub(base.len()) {
                Some(hat) => first + (hat / count.max(1)) * of_axis + hat % count.max(1),
                None => i,
            };
            for block in
                combined.normals(padded + hats.len().next_multiple_of(LANES), search.problem.threads, 1)
            {
                for i in 0..base.len() + hats.len() {
                    joint.vector[target(i)] += block.vector[place(i)];
                    for j in 0..base.len() + hats.len() {
                        joint.matrix[(target(i), target(j))] += block.matrix[(place(i), place(j))];
                    }
                }
            }
            first += count;
        }
        let variance = |i: usize| variances.get(*base.get(i)?).map(|v| v.max(1e-12));
        let bare_variance = |i: usize| base.get(i).map(|b| search.layout.base_variance(*b).max(1e-12));
        let own: Vec<usize> = (0..base.len()).collect();
        let bare: Vec<usize> = (0..base_size).collect();
        let without = Estimate::new(&joint, &own, |i| variance(i).unwrap_or(1.0))?;
        let bare_without = Estimate::new(&joint, &bare, |i| bare_variance(i).unwrap_or(1.0))?;
        let tried: Vec<(usize, f64)> =
            (0..3).flat_map(|axis| SIZES.iter().map(move |size| (axis, *size))).collect();
        let scored = threads::map(search.problem.threads, &tried, |(axis, size)| {
            let hats = base.len() + axis * of_axis..base.len() + (axis + 1) * of_axis;
            let with = |known: &[usize], variance: &dyn Fn(usize) -> Option<f64>| {
                let active: Vec<usize> = known.iter().copied().chain(hats.clone()).collect();
                Estimate::new(&joint, &active, |i| variance(i).unwrap_or(size * size))
            };
            Some((*axis, with(&own, &variance)?, with(&bare, &bare_variance)?))
        });
        let choices = (2.0 * tried.len() as f64).ln();
        for (axis, beside, alone) in scored.into_iter().flatten() {
            let here = Wander {
                world,
                axis,
                added_evidence: beside.log_evidence - without.log_evidence - choices,
                added_drop: beside.drop - without.drop,
                alone_evidence: alone.log_evidence - bare_without.log_evidence - choices,
            };
            match &mut best {
                None => best = Some(here),
                Some(best) => {
                    let alone_evidence = best.alone_evidence.max(here.alone_evidence);
                    if here.added_evidence > best.added_evidence {
                        *best = here;
                    }
                    best.alone_evidence = alone_evidence;
                }
            }
        }
    }
    best
}
