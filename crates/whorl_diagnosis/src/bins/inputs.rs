//! What the actuators were told, integrated over the intervals between nodes.
//!
//! Jets and wheel torques change within an interval. Their exact integrals enter the momentum, and the
//! mean of their running integral over the samples of a node corrects the node's mean rate, so that a
//! valve edge counts at its own time whatever the grid.

use nalgebra::Vector3;
use whorl_dynamics::effects::ThrustLag;
use whorl_dynamics::{Environment, Gyrostat};
use whorl_recording::{OnInterval, Series};
use whorl_trajectory::bins::SampleTimes;

/// A piecewise constant signal as its running integral.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunningIntegral {
    /// Start of each piece \[s\].
    start_s: Vec<f64>,
    /// Value of each piece.
    value: Vec<f64>,
    /// Integral up to the start of each piece.
    integral: Vec<f64>,
}

impl RunningIntegral {
    fn from_pieces(pieces: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut signal = Self::default();
        let mut sum = 0.0;
        let mut previous: Option<(f64, f64)> = None;
        for (start_s, value) in pieces {
            if let Some((since_s, held)) = previous {
                sum += held * (start_s - since_s);
            }
            signal.start_s.push(start_s);
            signal.value.push(value);
            signal.integral.push(sum);
            previous = Some((start_s, value));
        }
        signal
    }

    /// A command that holds until the next, within +-`limit`.
    pub fn held<T>(series: &Series<T>, limit: f64, value: impl Fn(&T) -> f64) -> Self {
        let values = series.value.iter().map(|v| value(v).max(-limit).min(limit));
        Self::from_pieces(series.time_s.iter().copied().zip(values))
    }

    /// Integral from long ago to `time_s`.
    pub fn at(&self, time_s: f64) -> f64 {
        let after = self.start_s.partition_point(|t| *t <= time_s);
        let Some(piece) = after.checked_sub(1) else { return 0.0 };
        match (self.integral.get(piece), self.value.get(piece), self.start_s.get(piece)) {
            (Some(integral), Some(value), Some(start_s)) => integral + value * (time_s - start_s),
            _ => 0.0,
        }
    }

    fn is_zero(&self) -> bool {
        self.value.iter().all(|v| *v == 0.0)
    }
}

/// One jet's share of nominal thrust over time: the valve's state passed through the lag of the thrust.
struct JetFlow {
    lag: ThrustLag,
    /// Edges of the valve in order of time.
    edges: Vec<Edge>,
}

/// The valve opens or shuts.
struct Edge {
    time_s: f64,
    opens: bool,
    /// Share of nominal thrust then.
    flow: f64,
    /// Integral of the share up to then [s].
    impulse_s: f64,
}

impl JetFlow {
    fn new(mut open: Vec<(f64, f64)>, lag: ThrustLag) -> Self {
        open.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut disjoint: Vec<(f64, f64)> = Vec::with_capacity(open.len());
        for (from_s, to_s) in open {
            match disjoint.last_mut() {
                Some(last) if from_s <= last.1 => last.1 = last.1.max(to_s),
                _ => disjoint.push((from_s, to_s)),
            }
        }
        let mut flow = Self { lag, edges: Vec::with_capacity(2 * disjoint.len()) };
        for (from_s, to_s) in disjoint {
            for (time_s, opens) in [(from_s, true), (to_s, false)] {
                let (share, impulse_s) = flow.edges.last().map_or((0.0, 0.0), |last| {
                    let elapsed_s = time_s - last.time_s;
                    (lag.fraction(last.flow, last.opens, elapsed_s), last.impulse_after(lag, elapsed_s))
                });
                flow.edges.push(Edge { time_s, opens, flow: share, impulse_s });
            }
        }
        flow
    }

    /// Integral of the flow's share up to `time_s` \[s\].
    fn at(&self, time_s: f64) -> f64 {
        let after = self.edges.partition_point(|edge| edge.time_s <= time_s);
        let last = after.checked_sub(1).and_then(|last| self.edges.get(last));
        last.map_or(0.0, |edge| edge.impulse_after(self.lag, time_s - edge.time_s))
    }
}

impl Edge {
    fn impulse_after(&self, lag: ThrustLag, elapsed_s: f64) -> f64 {
        self.impulse_s + lag.impulse_s(self.flow, self.opens, elapsed_s)
    }
}

/// Inputs of one run, by interval and node.
#[derive(Debug, Clone, Default)]
pub(crate) struct Inputs {
    /// Number of jets.
    pub jets: usize,
    /// Mean share of flow of each jet over each interval, jets x intervals.
    pub jet_mean: Vec<f64>,
    /// Mean over the node's samples of the flow's integral since the node \[s\], jets x nodes.
    pub jet_mean_integral_s: Vec<f64>,
    /// True if any jet flows in the interval or near the node.
    pub jet_active: Vec<bool>,
}

impl Inputs {
    /// Share of flow of every jet in interval `k`.
    pub fn jets_at(&self, k: usize) -> &[f64] {
        self.jet_mean.get(k * self.jets..(k + 1) * self.jets).unwrap_or(&[])
    }

    /// Mean running integral of every jet at node `k` \[s\].
    pub fn jet_integrals_at(&self, k: usize) -> &[f64] {
        self.jet_mean_integral_s.get(k * self.jets..(k + 1) * self.jets).unwrap_or(&[])
    }

    /// True if some jet matters in interval `k`.
    pub fn is_active(&self, k: usize) -> bool {
        self.jet_active.get(k).copied().unwrap_or(false)
    }

    /// Carries out the commanded pulses on valves as `gyrostat` has them. `environment_at` is what effects
    /// see at a time.
    pub fn jets<'e>(
        pulses: &[Vec<OnInterval>],
        gyrostat: &Gyrostat,
        times: &SampleTimes,
        environment_at: &dyn Fn(f64) -> Environment<'e>,
    ) -> Self {
        let jets = gyrostat.model().jets().len();
        let nodes = times.node_s.len();
        let mut inputs = Self {
            jets,
            jet_mean: vec![0.0; jets * nodes],
            jet_mean_integral_s: vec![0.0; jets * nodes],
            jet_active: vec![false; nodes],
        };
        for (j, (jet, pulses)) in gyrostat.model().jets().iter().zip(pulses).enumerate() {
            if pulses.is_empty() {
                continue;
            }
            let mut open = Vec::with_capacity(pulses.len());
            for pulse in pulses {
                if pulse.off_s - pulse.on_s < jet.min_on_time_s - 1e-6 {
                    continue;
                }
                let (later_open_s, later_close_s) =
                    gyrostat.effects().valve_delay_s(&environment_at(pulse.on_s));
                let from_s = pulse.on_s + jet.opening_delay_s + later_open_s;
                let to_s = pulse.off_s + jet.closing_delay_s + later_close_s;
                if to_s > from_s {
                    open.push((from_s, to_s));
                }
            }
            let flow = JetFlow::new(open, gyrostat.thrust_lag());
            inputs.fill_jet(j, times, |t| flow.at(t));
        }
        inputs
    }

    fn fill_jet(&mut self, j: usize, times: &SampleTimes, integral: impl Fn(f64) -> f64) {
        let at_node: Vec<f64> = times.node_s.iter().map(|t| integral(*t)).collect();
        for (k, pair) in at_node.windows(2).enumerate() {
            let (Some(t0), Some(t1)) = (times.node_s.get(k), times.node_s.get(k + 1)) else { continue };
            let [from, to] = pair else { continue };
            let mean = (to - from) / (t1 - t0);
            if mean.abs() > 1e-12 {
                if let Some(slot) = self.jet_mean.get_mut(k * self.jets + j) {
                    *slot = mean;
                }
                for node in [k, k + 1] {
                    if let Some(active) = self.jet_active.get_mut(node) {
                        *active = true;
                    }
                }
            }
        }
        for (k, samples) in times.samples_s.iter().enumerate() {
            // Flow before or after the node within its samples.
            let near = self.jet_active.get(k).copied().unwrap_or(false)
                || k.checked_sub(1).is_some_and(|p| self.jet_active.get(p).copied().unwrap_or(false));
            if !near || samples.len() < 2 {
                continue;
            }
            let Some(origin) = at_node.get(k) else { continue };
            let sum: f64 = samples.iter().map(|t| integral(*t) - origin).sum();
            if let Some(slot) = self.jet_mean_integral_s.get_mut(k * self.jets + j) {
                *slot = sum / samples.len() as f64;
            }
        }
    }
}

/// Means over intervals and mean running integrals at nodes of signals that no parameter changes.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeldInput {
    /// Mean over each interval.
    pub mean: Vec<f64>,
    /// Mean over the node's samples of the integral since the node.
    pub mean_integral: Vec<f64>,
}

impl HeldInput {
    pub fn new(signal: &RunningIntegral, times: &SampleTimes) -> Self {
        let nodes = times.node_s.len();
        let mut input = Self { mean: vec![0.0; nodes], mean_integral: vec![0.0; nodes] };
        if signal.is_zero() {
            return input;
        }
        let at_node: Vec<f64> = times.node_s.iter().map(|t| signal.at(*t)).collect();
        for (k, slot) in input.mean.iter_mut().enumerate() {
            if let (Some(from), Some(to), Some(t0), Some(t1)) =
                (at_node.get(k), at_node.get(k + 1), times.node_s.get(k), times.node_s.get(k + 1))
            {
                *slot = (to - from) / (t1 - t0);
            }
        }
        for ((slot, samples), origin) in input.mean_integral.iter_mut().zip(&times.samples_s).zip(&at_node) {
            if samples.len() > 1 {
                *slot = samples.iter().map(|t| signal.at(*t) - origin).sum::<f64>() / samples.len() as f64;
            }
        }
        input
    }

    pub fn mean_at(&self, k: usize) -> f64 {
        self.mean.get(k).copied().unwrap_or(0.0)
    }

    pub fn mean_integral_at(&self, k: usize) -> f64 {
        self.mean_integral.get(k).copied().unwrap_or(0.0)
    }
}

/// Commanded moment of the moving masses at the nodes, and the sense of their last travel.
pub(crate) fn ballast(
    series: &Series<Vector3<f64>>,
    node_s: &[f64],
) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
    let mut moments = Vec::with_capacity(node_s.len());
    let mut directions = Vec::with_capacity(node_s.len());
    let (mut next, mut moment, mut direction) = (0, Vector3::zeros(), Vector3::zeros());
    for t in node_s {
        while let (Some(stamp), Some(value)) = (series.time_s.get(next), series.value.get(next)) {
            if stamp > t {
                break;
            }
            if next > 0 {
                let travel: Vector3<f64> = value - moment;
                for i in 0..3 {
                    if travel[i].abs() > 1e-9 {
                        direction[i] = travel[i].signum();
                    }
                }
            }
            moment = *value;
            next += 1;
        }
        moments.push(moment);
        directions.push(direction);
    }
    (moments, directions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lag_of_the_thrust_keeps_the_impulse_and_delays_it() {
        let lag = |rise_s: f64, tail_s: f64| ThrustLag { rise_s, tail_s, ..ThrustLag::default() };
        let sharp = JetFlow::new(vec![(1.0, 1.3), (2.0, 2.1)], lag(0.0, 0.0));
        let lagged = JetFlow::new(vec![(1.0, 1.3), (2.0, 2.1)], lag(0.05, 0.05));
        assert!((sharp.at(1.2) - 0.2).abs() < 1e-12);
        assert!((sharp.at(5.0) - 0.4).abs() < 1e-12);
        assert!((lagged.at(5.0) - 0.4).abs() < 1e-9);
        // During a long pulse the lag costs tau of impulse.
        let delayed = JetFlow::new(vec![(0.0, 10.0)], lag(0.05, 0.02));
        assert!((delayed.at(8.0) - 7.95).abs() < 1e-9);
        // A longer tail gives more than the rise has cost, and the next pulse starts from what is left of it:
        // the differential equation by small steps.
        let uneven = JetFlow::new(vec![(0.01, 0.05), (0.08, 0.1)], lag(0.02, 0.06));
        let step_s = 1e-6;
        let (mut flow, mut impulse_s) = (0.0, 0.0);
        for k in 0..300_000 {
            let time_s = (f64::from(k) + 0.5) * step_s;
            let open = (0.01..0.05).contains(&time_s) || (0.08..0.1).contains(&time_s);
            let rate = if open { (1.0 - flow) / 0.02 } else { -flow / 0.06 };
            impulse_s += (flow + 0.5 * rate * step_s) * step_s;
            flow += rate * step_s;
        }
        assert!((uneven.at(0.3) - impulse_s).abs() < 1e-6, "{} {impulse_s}", uneven.at(0.3));
    }

    #[test]
    fn a_held_command_integrates_piecewise() {
        let series = Series { time_s: vec![0.0, 1.0, 3.0], value: vec![1.0, -2.0, 0.0] };
        let signal = RunningIntegral::held(&series, 1.5, |v| *v);
        assert_eq!(signal.at(-1.0), 0.0);
        assert!((signal.at(2.0) - (1.0 - 1.5)).abs() < 1e-12);
        assert!((signal.at(10.0) - (1.0 - 3.0)).abs() < 1e-12);
    }
}
