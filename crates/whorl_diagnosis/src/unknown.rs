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
    value: Box<dyn Fn(&Run, &Motion, usize) -> f64 + Sync + Send>,
    /// Second shape that goes with it (phase of a line, both signs of an angle).
    pair: bool,
}

type Value = Box<dyn Fn(&Run, &Motion, usize) -> f64 + Sync + Send>;

fn shapes(search: &Search<'_>) -> Vec<Vec<Shape>> {
    let mut groups: Vec<Vec<Shape>> = Vec::new();
    let single = |variable: &str, parity: &'static str, value: Value| Shape {
        variable: variable.to_owned(),
        parity,
        frequency_hz: None,
        value,
        pair: false,
    };
    let mut add = |variable: &str, scale: f64, centre: f64, value: Value| {
        let value = std::sync::Arc::new(value);
        for (parity, power) in [("odd", 1), ("even", 2), ("odd", 3)] {
            let value = std::sync::Arc::clone(&value);
            let shape: Value =
                Box::new(move |run, motion, k| ((value(run, motion, k) - centre) / scale).powi(power));
            groups.push(vec![single(variable, parity, shape)]);
        }
        let value = std::sync::Arc::clone(&value);
        let sense: Value = Box::new(move |run, motion, k| {
            let x = (value(run, motion, k) - centre) / scale;
            x / x.hypot(0.05)
        });
        groups.push(vec![single(variable, "odd", sense)]);
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
    // Heading: first and second harmonic.
    for n in [1.0, 2.0] {
        let sine: Value = Box::new(move |_, m, k| m.q.get(k).map_or(0.0, |q| (n * azimuth_rad(q)).sin()));
        let cosine: Value = Box::new(move |_, m, k| m.q.get(k).map_or(0.0, |q| (n * azimuth_rad(q)).cos()));
        let mut first = single("yaw", "none", sine);
        first.pair = true;
        groups.push(vec![first, single("yaw", "none", cosine)]);
    }
    for hz in &search.lines.torque_hz {
        let hz = *hz;
        let w = std::f64::consts::TAU * hz;
        let sine: Value = Box::new(move |run, _, k| (w * (run.time(k) + 0.5 * run.length_or_zero(k))).sin());
        let cosine: Value = Box::new(move |run, _, k| (w * (run.time(k) + 0.5 * run.length_or_zero(k))).cos());
        let mut first = single("time", "none", sine);
        first.frequency_hz = Some(hz);
        let mut second = single("time", "none", cosine);
        second.frequency_hz = Some(hz);
        groups.push(vec![first, second]);
    }
    groups
}

/// The shape that explains most of what is left.
pub(crate) fn describe(search: &Search<'_>) -> Option<Unknown> {
    let groups = shapes(search);
    let linearised = search.problem.linearise(&search.point).ok()?;
    // Every shape about every axis of both frames, as columns of their own regression beside the base.
    let mut owners: Vec<(usize, bool, usize)> = Vec::new();
    let mut columns: Vec<(usize, usize, bool, usize)> = Vec::new();
    for (g, group) in groups.iter().enumerate() {
        for world in [false, true] {
            for axis in 0..3 {
                owners.push((g, world, axis));
                for s in 0..group.len() {
                    columns.push((g, s, world, axis));
                }
            }
        }
    }
    let base = &search.layout.base;
    let estimate = search.base.estimate.spread(search.layout.columns.len());
    let _ = estimate;
    let lanes = crate::columns::LANES;
    let chunks: Vec<&[(usize, usize, bool, usize)]> = columns.chunks(lanes).collect();
    let work: Vec<(usize, usize)> =
        (0..search.problem.runs.len()).flat_map(|r| (0..chunks.len()).map(move |c| (r, c))).collect();
    let responses = threads::map(search.problem.threads, &work, |&(r, c)| {
        let (Some(run), Some(motion), Some(linear), Some(chunk)) = (
            search.problem.runs.get(r),
            search.problem.motions.get(r),
            linearised.get(r),
            chunks.get(c),
        ) else {
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
    let known = search.layout.columns.len();
    let mut joint = Normal::zeros(base.len() + total);
    for (run_index, slot) in whitened.iter_mut().enumerate() {
        slot.y = vec![0.0; slot.channel.len()];
        slot.colour(search.data.colours.get(run_index)?);
        let old = search.data.whitened.get(run_index)?;
        let mut combined = Whitened {
            groups: old.groups.clone(),
            y: old.y.clone(),
            channel: slot.channel.clone(),
            node: slot.node.clone(),
            nodes: slot.nodes,
        };
        let padded = old.groups.len() * lanes;
        combined.groups.append(&mut slot.groups);
        for block in combined.normals(padded + chunks.len() * lanes, search.problem.threads) {
            let index = |i: usize| if i < base.len() { base[i] } else { padded + i - base.len() };
            for i in 0..base.len() + total {
                joint.vector[i] += block.vector[index(i)];
                for j in 0..base.len() + total {
                    joint.matrix[(i, j)] += block.matrix[(index(i), index(j))];
                }
            }
        }
    }
    let _ = known;
    let variance = |i: usize| if i < base.len() { search.layout.base_variance(base[i]) } else { 100.0 };
    let own: Vec<usize> = (0..base.len()).collect();
    let without = Estimate::new(&joint, &own, variance)?;
    let column_of = |owner: &(usize, bool, usize)| -> Vec<usize> {
        columns
            .iter()
            .enumerate()
            .filter(|(_, c)| (c.0, c.2, c.3) == *owner)
            .map(|(i, _)| base.len() + i)
            .collect()
    };
    let scored = threads::map(search.problem.threads, &owners, |owner| {
        let mut active = own.clone();
        active.extend(column_of(owner));
        Estimate::new(&joint, &active, variance).map_or((0.0, 0.0), |with| {
            (with.log_evidence - without.log_evidence, with.drop - without.drop)
        })
    });
    let (best, (_, drop)) = owners
        .iter()
        .zip(&scored)
        .max_by(|a, b| a.1.0.total_cmp(&b.1.0))
        .map(|(o, s)| (*o, *s))?;
    let (group, world, axis) = best;
    let shape = groups.get(group)?.first()?;
    let left = (search.data.total.sum_of_squares - search.base.estimate.drop - search.data.total.rows).max(drop);
    let name = ["x", "y", "z"].get(axis).copied().unwrap_or("z");
    let _ = shape.pair;
    Some(Unknown {
        variable: shape.variable.clone(),
        frame: if world { "world" } else { "body" }.to_owned(),
        axis: name.to_owned(),
        parity: shape.parity.to_owned(),
        frequency_hz: shape.frequency_hz,
        share: (drop / left.max(1.0)).clamp(0.0, 1.0),
    })
}
