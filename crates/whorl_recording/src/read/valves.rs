//! Switching times of the valves, from the driver's messages.
//!
//! A `ThrusterState` tells the valve's state at its stamp and the on-time since the message before. A valve
//! that was shut then and is open now was opened an on-time before now; one that was open and is shut now was
//! shut an on-time after then. So edges are known to the nanosecond, although messages come at 100 Hz. Only for
//! a pulse that lies between two messages the commands say where.

use whorl_msgs::whorl::ThrusterState;

use super::commands::{PulseNs, add};

/// On-times below this are rounding \[ns\].
const TOLERANCE_NS: i64 = 1_000;

/// What a message says of all valves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Valves {
    open: Vec<bool>,
    on_time_s: Vec<f64>,
    total_on_time_s: Vec<f64>,
}

impl Valves {
    pub fn of(state: &ThrusterState) -> Self {
        Self {
            open: state.valve_open.clone(),
            on_time_s: state.on_time_s.clone(),
            total_on_time_s: state.total_on_time_s.clone(),
        }
    }

    fn is_quiet(&self) -> bool {
        !self.open.contains(&true) && self.on_time_s.iter().all(|t| *t == 0.0)
    }
}

/// Adds a message. Of a time in which nothing happens the first and the last are enough: a run is mostly such time.
pub(super) fn push(states: &mut Vec<(i64, Valves)>, at_ns: i64, valves: Valves) {
    if let [.., (first_ns, first), (last_ns, last)] = states.as_mut_slice()
        && *first_ns < *last_ns
        && *last_ns < at_ns
        && valves.is_quiet()
        && *first == valves
        && *last == valves
    {
        *last_ns = at_ns;
    } else {
        states.push((at_ns, valves));
    }
}

/// Pulses of each jet from the driver's messages in order of time; `commanded` places pulses that lie between
/// two messages.
pub(super) fn pulses(states: &[(i64, Valves)], commanded: &[Vec<PulseNs>]) -> Vec<Vec<PulseNs>> {
    let Some((_, first)) = states.first() else { return Vec::new() };
    (0..first.open.len())
        .map(|jet| {
            let commanded = commanded.get(jet).map_or(&[][..], Vec::as_slice);
            jet_pulses(states, jet, commanded)
        })
        .collect()
}

/// What one message says of one valve.
#[derive(Clone, Copy)]
struct Valve {
    at_ns: i64,
    open: bool,
    total_s: Option<f64>,
}

fn jet_pulses(states: &[(i64, Valves)], jet: usize, commanded: &[PulseNs]) -> Vec<PulseNs> {
    let mut pulses = Vec::new();
    let mut before: Option<Valve> = None;
    for (at_ns, state) in states {
        let Some(&open) = state.open.get(jet) else { continue };
        let total_s = state.total_on_time_s.get(jet).copied().filter(|t| t.is_finite());
        let since_s = state.on_time_s.get(jet).copied().filter(|t| t.is_finite());
        let now = Valve { at_ns: *at_ns, open, total_s };
        // Totals also cover messages that were lost; they begin anew with the driver.
        let growth_s = before.and_then(|b| b.total_s).zip(total_s).map(|(b, n)| n - b).filter(|d| *d >= 0.0);
        let on_ns = (growth_s.or(since_s).unwrap_or(0.0).max(0.0) * 1e9).round() as i64;
        match before {
            // What was before the first message is known by its own on-time only.
            None if open => add(&mut pulses, PulseNs { on_ns: now.at_ns - on_ns, off_ns: now.at_ns }),
            None => {}
            Some(before) => between(&mut pulses, before, now, on_ns, commanded),
        }
        if open && before.is_some_and(|b| !b.open) && on_ns == 0 {
            // Opened at the stamp itself.
            pulses.push(PulseNs { on_ns: now.at_ns, off_ns: now.at_ns });
        }
        before = Some(now);
    }
    pulses.retain(|pulse| pulse.off_ns > pulse.on_ns);
    pulses
}

fn between(pulses: &mut Vec<PulseNs>, before: Valve, now: Valve, on_ns: i64, commanded: &[PulseNs]) {
    let (start, end) = (before.at_ns, now.at_ns);
    let on_ns = on_ns.min(end - start);
    // Where a command opened the valve in between.
    let opened = || {
        let next = commanded.partition_point(|pulse| pulse.on_ns < start);
        commanded.get(next).map(|pulse| pulse.on_ns).filter(|on| *on < end)
    };
    // Messages may be closer than rounding: what a valve was at both, or since or until one of them, it was.
    match (before.open, now.open) {
        (false, true) => add(pulses, PulseNs { on_ns: end - on_ns, off_ns: end }),
        (true, false) => add(pulses, PulseNs { on_ns: start, off_ns: start + on_ns }),
        (true, true) if on_ns + TOLERANCE_NS >= end - start => {
            add(pulses, PulseNs { on_ns: start, off_ns: end })
        }
        (false, false) | (true, true) if on_ns < TOLERANCE_NS => {}
        (true, true) => {
            // Shut and opened again in between: only after a lost message.
            let second_ns = opened().map_or(on_ns / 2, |on| (end - on).min(on_ns));
            add(pulses, PulseNs { on_ns: start, off_ns: start + (on_ns - second_ns) });
            add(pulses, PulseNs { on_ns: end - second_ns, off_ns: end });
        }
        (false, false) => {
            let on = opened().unwrap_or(start + (end - start - on_ns) / 2);
            let on = on.min(end - on_ns);
            add(pulses, PulseNs { on_ns: on, off_ns: on + on_ns });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One jet's pulses \[ns\], out of messages: stamp \[ns\], open, total on-time \[ns\].
    fn read(messages: &[(i64, bool, i64)]) -> Vec<(i64, i64)> {
        let state = |&(at_ns, open, total_ns): &(i64, bool, i64)| {
            let total_on_time_s = vec![total_ns as f64 * 1e-9];
            (at_ns, ThrusterState { valve_open: vec![open], total_on_time_s, ..ThrusterState::default() })
        };
        let mut states = Vec::new();
        for (at_ns, state) in messages.iter().map(state) {
            push(&mut states, at_ns, Valves::of(&state));
        }
        pulses(&states, &[]).remove(0).iter().map(|pulse| (pulse.on_ns, pulse.off_ns)).collect()
    }

    #[test]
    fn of_quiet_time_the_ends_are_kept() {
        let total_ns = |k: i64| if k < 100 { 0 } else { 3_000_000 };
        // A pulse of 3 ms that ended 2 ms before message 100, and one that is open at message 200.
        let mut messages: Vec<_> = (0..300).map(|k| (k * 10_000_000, false, total_ns(k))).collect();
        messages[200] = (2_000_000_000, true, 4_000_000);
        messages[201..].iter_mut().for_each(|message| message.2 = 5_000_000);
        let mut states = Vec::new();
        for &(at_ns, open, total) in &messages {
            let total_on_time_s = vec![total as f64 * 1e-9];
            let state = ThrusterState { valve_open: vec![open], total_on_time_s, ..ThrusterState::default() };
            push(&mut states, at_ns, Valves::of(&state));
        }
        let kept: Vec<i64> = states.iter().map(|(at_ns, _)| at_ns / 10_000_000).collect();
        assert_eq!(kept, [0, 99, 100, 199, 200, 201, 299]);
        let commanded = vec![vec![PulseNs { on_ns: 995_000_000, off_ns: 998_000_000 }]];
        let pulses = pulses(&states, &commanded).remove(0);
        let pulses: Vec<(i64, i64)> = pulses.iter().map(|p| (p.on_ns, p.off_ns)).collect();
        assert_eq!(pulses, [(995_000_000, 998_000_000), (1_999_000_000, 2_001_000_000)]);
    }

    #[test]
    fn messages_closer_than_rounding_neither_cut_nor_shift_a_pulse() {
        let opened = [(0, false, 0), (1_000_000, true, 0), (5_000_000, true, 4_000_000)];
        let with = |rest: &[(i64, bool, i64)]| read(&[&opened[..], rest].concat());
        assert_eq!(
            with(&[(5_000_117, true, 4_000_117), (9_000_000, false, 8_000_000)]),
            [(1_000_000, 9_000_000)]
        );
        assert_eq!(with(&[(5_000_117, false, 4_000_117)]), [(1_000_000, 5_000_117)]);
        // Opened 117 ns before a message.
        assert_eq!(
            read(&[(0, false, 0), (1_000_000, true, 117), (2_000_000, false, 500_117)]),
            [(999_883, 1_500_000)]
        );
        // Rounding is no pulse.
        assert_eq!(read(&[(0, false, 0), (1_000_000, false, 3)]), []);
    }
}
