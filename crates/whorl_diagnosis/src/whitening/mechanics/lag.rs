//! What the low-pass of a sensor holds back.
//!
//! For tau dy/dt = x - y the part held back, l = x - y, follows dl/dt = dx/dt - l/tau: between nodes x goes along a
//! straight line, at nodes it may jump, so that l is known in closed form everywhere.

use nalgebra::Vector3;

use crate::bins::run::Run;

/// Mean over the samples of every node of what a low-pass with time constant `tau_s` holds back of x, whose slope over
/// interval `k` is `slope(k)` and which jumps by `jump(k)` at node `k`. It had settled when the run began.
pub(super) fn held_back(
    run: &Run,
    tau_s: f64,
    slope: impl Fn(usize) -> Vector3<f64>,
    jump: impl Fn(usize) -> Vector3<f64>,
) -> Vec<Vector3<f64>> {
    let nodes = run.nodes();
    let mut mean = Vec::with_capacity(nodes);
    // Before and after the jump at the node, and the interval before.
    let mut after = slope(0) * tau_s;
    let mut earlier: Option<(Vector3<f64>, Vector3<f64>, f64)> = None;
    for k in 0..nodes {
        let before = earlier.map_or(after, |(start, ramp, length)| settled(&start, &ramp, length, tau_s));
        if earlier.is_some() {
            after = before + jump(k);
        }
        let ramp = slope(k) * tau_s;
        let at = |offset_s: f64| {
            if offset_s.abs() < 1e-9 {
                (before + after) * 0.5
            } else if offset_s > 0.0 {
                settled(&after, &ramp, offset_s, tau_s)
            } else {
                earlier.map_or(after, |(start, ramp, length)| {
                    settled(&start, &ramp, (length + offset_s).max(0.0), tau_s)
                })
            }
        };
        let samples = run.times.samples_s.get(k).map_or(&[][..], Vec::as_slice);
        let sum: Vector3<f64> = samples.iter().map(|t| at(t - run.time(k))).sum();
        mean.push(if samples.is_empty() { at(0.0) } else { sum / samples.len() as f64 });
        earlier = Some((after, ramp, run.length_or_zero(k)));
    }
    mean
}

/// What is held back `elapsed_s` after it was `start`, on its way to `ramp`.
fn settled(start: &Vector3<f64>, ramp: &Vector3<f64>, elapsed_s: f64, tau_s: f64) -> Vector3<f64> {
    ramp + (start - ramp) * (-elapsed_s / tau_s).exp()
}
