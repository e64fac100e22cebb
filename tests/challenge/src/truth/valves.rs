//! Valves and the plena behind the nozzles.

use whorl_recording::OnInterval;

/// Gas dynamics of one jet over a run: when its valve is open, and the plenum behind its nozzle.
#[derive(Debug, Clone, Default)]
struct Valve {
    /// (time, open?, then: opening, fraction of full thrust; shutting, place on the curve of the blow-down),
    /// by time.
    edges: Vec<(f64, bool, f64)>,
}

/// All valves over a run.
#[derive(Debug, Clone)]
pub struct Valves {
    valves: Vec<Valve>,
    fill_s: f64,
    /// From this time on, these jets may blow; by time.
    blowing: Vec<(f64, Vec<usize>)>,
}

/// Blow-down of a plenum through a choked nozzle from full pressure, after `s` of its time constants. It starts
/// isentropic, nitrogen's (1 + (gamma - 1)/2 t/t0)^(-2 gamma/(gamma - 1)); then heat from the wall holds it up, here
/// by a slower exponential beside it. Its impulse is one time constant of full thrust.
fn blown_down(s: f64) -> f64 {
    0.7 * (1.0 + 0.2 * s / ISENTROPIC_S).powi(-7) + 0.3 * (-s / WARMED_S).exp()
}

/// Where on that curve a plenum with this share of full thrust is: it falls on from there.
fn place_on_curve(share: f64) -> f64 {
    let (mut early, mut late) = (0.0, TAIL);
    for _ in 0..50 {
        let middle = 0.5 * (early + late);
        if blown_down(middle) > share {
            early = middle;
        } else {
            late = middle;
        }
    }
    early
}

const WARMED_S: f64 = 1.5;
/// 0.7 t0 / 1.2 + 0.3 * 1.5 = 1.
const ISENTROPIC_S: f64 = 0.55 * 1.2 / 0.7;
/// After this many time constants the rest is negligible.
const TAIL: f64 = 40.0;

impl Valves {
    /// `pulses` are commands; delays are (opening, closing) of each jet and pulse.
    pub fn new(
        pulses: &[Vec<OnInterval>],
        delay_s: impl Fn(usize, &OnInterval) -> (f64, f64),
        fill_s: f64,
    ) -> Self {
        let mut valves = Vec::new();
        let mut times = vec![(f64::NEG_INFINITY, usize::MAX, false)];
        for (jet, commands) in pulses.iter().enumerate() {
            let mut valve = Valve::default();
            let mut intervals: Vec<(f64, f64)> = Vec::new();
            for pulse in commands {
                let (opening_s, closing_s) = delay_s(jet, pulse);
                let (open, close) = (pulse.on_s + opening_s, pulse.off_s + closing_s);
                if close <= open {
                    continue;
                }
                match intervals.last_mut() {
                    Some(last) if open <= last.1 => last.1 = last.1.max(close),
                    _ => intervals.push((open, close)),
                }
            }
            for (open, close) in intervals {
                let at_open = valve.fraction(open, fill_s);
                valve.edges.push((open, true, at_open));
                let at_close = valve.fraction(close, fill_s);
                valve.edges.push((close, false, place_on_curve(at_close)));
                times.push((open, jet, true));
                times.push((close + TAIL * fill_s, jet, false));
                times.push((close, usize::MAX, false));
            }
            valves.push(valve);
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut count = vec![0_i32; pulses.len()];
        let mut blowing = Vec::new();
        for (time, jet, starts) in times {
            if let Some(slot) = count.get_mut(jet) {
                *slot += if starts { 1 } else { -1 };
            }
            let now = (0..count.len()).filter(|j| count[*j] > 0).collect();
            blowing.push((time, now));
        }
        Self { valves, fill_s, blowing }
    }

    /// The next edge after `time_s`, if any.
    pub fn next_edge_s(&self, time_s: f64) -> f64 {
        let after = self.blowing.partition_point(|(t, _)| *t <= time_s + 1e-9);
        self.blowing.get(after).map_or(f64::INFINITY, |(t, _)| *t)
    }

    /// Jets that may blow from `time_s` to the next edge.
    pub fn blowing(&self, time_s: f64) -> &[usize] {
        let after = self.blowing.partition_point(|(t, _)| *t <= time_s + 1e-9);
        after.checked_sub(1).map_or(&[], |i| self.blowing[i].1.as_slice())
    }

    /// Share of full thrust.
    pub fn fraction(&self, jet: usize, time_s: f64) -> f64 {
        self.valves[jet].fraction(time_s, self.fill_s)
    }
}

impl Valve {
    fn fraction(&self, time_s: f64, fill_s: f64) -> f64 {
        // The same grace as `blowing`: at an edge, the state after it.
        let after = self.edges.partition_point(|(t, ..)| *t <= time_s + 1e-9);
        let Some((since, is_open, start)) = after.checked_sub(1).map(|i| self.edges[i]) else { return 0.0 };
        let elapsed = (time_s - since).max(0.0);
        match (is_open, fill_s > 0.0) {
            (true, false) => 1.0,
            (false, false) => 0.0,
            (true, true) => 1.0 - (1.0 - start) * (-elapsed / fill_s).exp(),
            (false, true) => blown_down(start + elapsed / fill_s),
        }
    }
}
