//! What drives a torque that no effect of the catalogue explains.
//!
//! Torques of simple shape (a function of one recorded variable, about one axis of the body or of the room)
//! pass through the whitening filter like any effect; the one that explains most names variable, frame,
//! axis and parity. This is the regression of a random-walk torque on the recorded channels (Kristensen et
//! al. 2004), without smoothing the torque first.

use nalgebra::Vector3;
use whorl_math::{azimuth_rad, vertical_b};

use crate::columns::torque_response;
use crate::diagnosis::Unknown;
use crate::motion::Motion;
use crate::regression::{Estimate, Normal, Whitened};
use crate::run::Run;
use crate::search::Search;
use crate::threads;

/// A variable, and its shape as odd or even.
struct Shape {
    variable: String,
    parity: &'static str,
    frequency_hz: Option<f64>,
    value: Value,
    /// It may act about an axis of the room as well as of the body.
    in_room: bool,
}

type Value = Box<dyn Fn(&Run, &Motion, usize) -> f64 + Sync + Send>;

fn shapes(search: &Search<'_>) -> Vec<Vec<Shape>> {
    let mut groups: Vec<Vec<Shape>> = Vec::new();
    let single = |variable: &str, parity: &'static str, value: Value| Shape {
        variable: variable.to_owned(),
        parity,
        frequency_hz: None,
        value,
        in_room: true,
    };
    let mut add = |variable: &str, scale: f64, centre: f64, value: Value| {
        let in_room =
            !variable.contains("rate") && !variable.contains("speed") && variable != "tank_pressure";
        let slow = matches!(variable, "tank_pressure" | "bus_voltage" | "temperature" | "time");
        let value = std::sync::Arc::new(value);
        for (parity, power) in [("odd", 1), ("even", 2), ("odd", 3)] {
            let value = std::sync::Arc::clone(&value);
            let shape: Value =
                Box::new(move |run, motion, k| ((value(run, motion, k) - centre) / scale).powi(power));
            groups.push(vec![Shape { in_room, ..single(variable, parity, shape) }]);
        }
        if slow {
            // A line through a zero of its own.
            let linear = std::sync::Arc::clone(&value);
            let shape: Value = Box::new(move |run, motion, k| (linear(run, motion, k) - centre) / scale);
            let first = Shape { in_room, ..single(variable, "odd", shape) };
            let second = Shape { in_room, ..single(variable, "odd", Box::new(|_, _, _| 1.0)) };
            groups.push(vec![first, second]);
        }
        let value = std::sync::Arc::clone(&value);
        let sense: Value = Box::new(move |run, motion, k| {
            let x = (value(run, motion, k) - centre) / scale;
            x / x.hypot(0.05)
        });
        groups.push(vec![Shape { in_room, ..single(variable, "odd", sense) }]);
    };
    for (i, name) in ["roll_rate", "pitch_rate", "yaw_rate"].into_iter().enumerate() {
        add(name, 0.1, 0.0, Box::new(move |_, m, k| m.omega.get(k).map_or(0.0, |w| w[i])));
    }
    add("rate", 0.1, 0.0, Box::new(|_, m, k| m.omega.get(k).map_or(0.0, Vector3::norm)));
    for (i, name) in ["tilt_x", "tilt_y"].into_iter().enumerate() {
        add(name, 0.03, 0.0, Box::new(move |_, m, k| m.q.get(k).map_or(0.0, |q| vertical_b(q)[i])));
    }
    for (j, wheel) in search.problem.reference.model.wheels.iter().enumerate() {
        let name = format!("{}_speed", wheel.name);
        add(&name, 30.0, 0.0, Box::new(move |_, m, k| m.wheel.get(k).map_or(0.0, |w| w[j])));
    }
    let of_run = |values: fn(&Run) -> &Vec<f64>| -> (f64, f64) {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for run in &search.problem.runs {
            for x in values(run) {
                low = low.min(*x);
                high = high.max(*x);
            }
        }
        (0.5 * (low + high), 0.5 * (high - low))
    };
    let mut slow = |name: &str, values: fn(&Run) -> &Vec<f64>| {
        let (centre, half) = of_run(values);
        if half > 1e-9 * centre.abs().max(1e-9) {
            add(name, half, centre, Box::new(move |run, _, k| values(run).get(k).copied().unwrap_or(0.0)));
        }
    };
    if search.problem.runs.iter().all(|r| r.has_pressure) {
        slow("tank_pressure", |r| &r.pressure_pa);
    }
    if search.problem.runs.iter().all(|r| r.has_voltage) {
        slow("bus_voltage", |r| &r.voltage_v);
    }
    if search.problem.runs.iter().all(|r| r.has_temperature) {
        slow("temperature", |r| &r.temperature_k);
    }
    slow("time", |r| &r.times.node_s);
    groups.push(vec![single("constant", "even", Box::new(|_, _, _| 1.0))]);
    // Heading: the first harmonics.
    for n in [1.0, 2.0, 3.0] {
        let sine: Value = Box::new(move |_, m, k| m.q.get(k).map_or(0.0, |q| (n * azimuth_rad(q)).sin()));
        let cosine: Value = Box::new(move |_, m, k| m.q.get(k).map_or(0.0, |q| (n * azimuth_rad(q)).cos()));
        let first = single("yaw", "none", sine);
        groups.push(vec![first, single("yaw", "none", cosine)]);
    }
    for hz in &search.lines.torque_hz {
        let hz = *hz;
        let w = std::f64::consts::TAU * hz;
        let sine: Value = Box::new(move |run, _, k| (w * (run.time(k) + 0.5 * run.length_or_zero(k))).sin());
        let cosine: Value =
            Box::new(move |run, _, k| (w * (run.time(k) + 0.5 * run.length_or_zero(k))).cos());
        let mut first = single("time", "none", sine);
        first.frequency_hz = Some(hz);
        let mut second = single("time", "none", cosine);
        second.frequency_hz = Some(hz);
        groups.push(vec![first, second]);
    }
    for (wheel, order) in &search.lines.orders {
        let (wheel, order) = (*wheel, *order);
        let name = search.problem.reference.model.wheels.get(wheel).map_or("wheel", |w| w.name.as_str());
        let phase = move |m: &Motion, k: usize| order * m.wheel_angle.get(k).map_or(0.0, |a| a[wheel]);
        let sine: Value = Box::new(move |_, m, k| phase(m, k).sin());
        let cosine: Value = Box::new(move |_, m, k| phase(m, k).cos());
        let shape = |value| Shape { in_room: false, ..single(&format!("{name}_angle"), "none", value) };
        groups.push(vec![shape(sine), shape(cosine)]);
    }
    groups
}

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

/// Finds the shape that explains most of what the best set of effects leaves.
pub(crate) fn describe(search: &Search<'_>) -> Option<Follower> {
    let groups = shapes(search);
    let linearised = search.problem.linearise(&search.point).ok()?;
    // Every shape about every axis of both frames, as columns of their own regression beside the base.
    let mut owners: Vec<(usize, bool, usize)> = Vec::new();
    let mut columns: Vec<(usize, usize, bool, usize)> = Vec::new();
    for (g, group) in groups.iter().enumerate() {
        let room = group.first().is_some_and(|s| s.in_room);
        for world in [false, true] {
            if world && !room {
                continue;
            }
            for axis in 0..3 {
                owners.push((g, world, axis));
                for s in 0..group.len() {
                    columns.push((g, s, world, axis));
                }
            }
        }
    }
    let base = &search.best.estimate.active;
    let variances = search.best.variances(&search.layout);
    let base_size = search.layout.base.len();
    let lanes = crate::columns::LANES;
    let chunks: Vec<&[(usize, usize, bool, usize)]> = columns.chunks(lanes).collect();
    let work: Vec<(usize, usize)> =
        (0..search.problem.runs.len()).flat_map(|r| (0..chunks.len()).map(move |c| (r, c))).collect();
    let responses = threads::map(search.problem.threads, &work, |&(r, c)| {
        let (Some(run), Some(motion), Some(linear), Some(chunk)) =
            (search.problem.runs.get(r), search.problem.motions.get(r), linearised.get(r), chunks.get(c))
        else {
            return Vec::new();
        };
        let torques: Vec<Vec<Vector3<f64>>> = chunk
            .iter()
            .map(|(g, s, world, axis)| {
                let mut unit = Vector3::zeros();
                unit[*axis] = 1e-3;
                let Some(shape) = groups.get(*g).and_then(|g| g.get(*s)) else { return Vec::new() };
                (0..run.nodes())
                    .map(|k| {
                        let size = (shape.value)(run, motion, k);
                        let direction = match motion.q.get(k) {
                            Some(q) if *world => q.inverse_transform_vector(&unit),
                            _ => unit,
                        };
                        direction * size
                    })
                    .collect()
            })
            .collect();
        torque_response(run, linear, &torques)
    });
    let mut whitened: Vec<Whitened> = search
        .data
        .whitened
        .iter()
        .map(|w| Whitened {
            groups: Vec::new(),
            y: Vec::new(),
            channel: w.channel.clone(),
            node: w.node.clone(),
            nodes: w.nodes,
        })
        .collect();
    for ((r, _), response) in work.iter().zip(responses) {
        whitened.get_mut(*r)?.groups.push(response);
    }
    let total = columns.len();
    // Cross products with the base's columns, run by run.
    let mut joint = Normal::zeros(base.len() + total);
    for (run_index, slot) in whitened.iter_mut().enumerate() {
        slot.y = vec![0.0; slot.channel.len()];
        slot.colour(search.data.colours.get(run_index)?, search.problem.threads);
        let old = search.data.whitened.get(run_index)?;
        let mut combined = Whitened {
            groups: old.selected(base),
            y: old.y.clone(),
            channel: slot.channel.clone(),
            node: slot.node.clone(),
            nodes: slot.nodes,
        };
        let padded = combined.groups.len() * lanes;
        combined.groups.append(&mut slot.groups);
        for block in combined.normals(padded + chunks.len() * lanes, search.problem.threads, 1) {
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
    let column_of = |owner: &(usize, bool, usize)| -> Vec<usize> {
        columns
            .iter()
            .enumerate()
            .filter(|(_, c)| (c.0, c.2, c.3) == *owner)
            .map(|(i, _)| base.len() + i)
            .collect()
    };
    let scored = threads::map(search.problem.threads, &owners, |owner| {
        let with = |known: &[usize], variance: &dyn Fn(usize) -> f64, without: &Estimate| {
            let mut active = known.to_vec();
            active.extend(column_of(owner));
            Estimate::new(&joint, &active, variance).map_or((0.0, 0.0), |with| {
                (with.log_evidence - without.log_evidence, with.drop - without.drop)
            })
        };
        (with(&own, &variance, &without), with(&bare, &bare_variance, &bare_without))
    });
    let choices = (owners.len() as f64).ln();
    let alone_evidence = scored.iter().map(|s| s.1.0).fold(f64::NEG_INFINITY, f64::max) - choices;
    let best_by = |score: &dyn Fn(&Score) -> f64| {
        owners.iter().zip(&scored).max_by(|a, b| score(a.1).total_cmp(&score(b.1))).map(|(o, s)| (*o, *s))
    };
    let (mut best, (added, _)) = best_by(&|s| s.0.0)?;
    // Where a shape alone outdoes every name, it says more than what it adds to the names.
    let explained = search.best.log_evidence - search.base.log_evidence;
    if alone_evidence > explained {
        best = best_by(&|s| s.1.0)?.0;
    }
    let (group, world, axis) = best;
    let shape = groups.get(group)?.first()?;
    let left = (search.data.total.sum_of_squares - search.base.estimate.drop - search.data.total.rows)
        .max(added.1 + search.best.estimate.drop - search.base.estimate.drop);
    let name = ["x", "y", "z"].get(axis).copied().unwrap_or("z");
    Some(Follower {
        unknown: Unknown {
            variable: shape.variable.clone(),
            frame: if world { "world" } else { "body" }.to_owned(),
            axis: name.to_owned(),
            parity: shape.parity.to_owned(),
            frequency_hz: shape.frequency_hz,
            share: (added.1 / left.max(1.0)).clamp(0.0, 1.0),
        },
        added_evidence: added.0 - choices,
        added_drop: added.1,
        alone_evidence,
    })
}
