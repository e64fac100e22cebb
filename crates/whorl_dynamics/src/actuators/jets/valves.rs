//! Valves of the jets: commanded pulses become edges on the integrator's own time line.

use nalgebra::Vector3;

use super::{Jet, MAX_JETS};
use crate::effects::ThrustLag;

/// A pulse as the valve carries it out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pulse {
    /// The valve's driver switches on \[ns\].
    pub on_ns: i64,
    /// The valve's driver switches off \[ns\].
    pub off_ns: i64,
    /// Gas starts to flow \[ns\].
    pub opens_ns: i64,
    /// Gas stops \[ns\]; not after `opens_ns` when the pulse is too short to open the valve.
    pub closes_ns: i64,
}

/// A broken valve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum JetFailure {
    /// Works.
    #[default]
    None,
    /// Never opens; the valve's driver does not notice.
    StuckClosed,
    /// Never closes.
    StuckOpen,
}

#[derive(Debug, Clone)]
struct Valve {
    torque_b_n_m: Vector3<f64>,
    thrust_n: f64,
    pulses: Vec<Pulse>,
    failure: JetFailure,
    /// On-time of pulses that are over \[ns\].
    driven_ns: i64,
    /// Open time up to the last update \[ns\].
    open_ns: i64,
    is_open: bool,
    /// Share of full thrust at the last update.
    flow: f64,
}

/// Jets at one instant, at reference pressure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JetDrive {
    pub torque_b_n_m: Vector3<f64>,
    pub thrust_n: f64,
}

/// All valves of a platform.
#[derive(Debug, Clone)]
pub(crate) struct Valves {
    valves: Vec<Valve>,
    lag: ThrustLag,
    /// What the open valves give once the lag of the thrust is over.
    target: JetDrive,
    /// Shortfall of the open jets at `since_ns`.
    lacking: JetDrive,
    since_ns: i64,
    next_edge_ns: i64,
}

const NOTHING: JetDrive = JetDrive { torque_b_n_m: Vector3::new(0.0, 0.0, 0.0), thrust_n: 0.0 };

impl JetDrive {
    fn add(&mut self, valve: &Valve, share: f64) {
        self.torque_b_n_m += valve.torque_b_n_m * share;
        self.thrust_n += valve.thrust_n * share;
    }
}

impl Valves {
    pub fn new(jets: &[Jet], lag: ThrustLag, now_ns: i64) -> Self {
        let valve = |jet: &Jet| Valve {
            torque_b_n_m: jet.torque_b_n_m(),
            thrust_n: jet.thrust_n,
            pulses: Vec::new(),
            failure: JetFailure::None,
            driven_ns: 0,
            open_ns: 0,
            is_open: false,
            flow: 0.0,
        };
        Self {
            valves: jets.iter().map(valve).collect(),
            lag,
            target: NOTHING,
            lacking: NOTHING,
            since_ns: now_ns,
            next_edge_ns: i64::MAX,
        }
    }

    /// Adds a pulse; one that touches or overlaps others becomes one with them. `None`: too short.
    pub fn add(&mut self, jet: usize, pulse: Pulse, min_on_time_ns: i64, now_ns: i64) -> Option<Pulse> {
        let valve = self.valves.get_mut(jet)?;
        let touches = |p: &Pulse| pulse.on_ns <= p.off_ns && p.on_ns <= pulse.off_ns;
        let joined = valve.pulses.iter().filter(|p| touches(p)).fold(pulse, |a, b| Pulse {
            on_ns: a.on_ns.min(b.on_ns),
            off_ns: a.off_ns.max(b.off_ns),
            opens_ns: a.opens_ns.min(b.opens_ns),
            closes_ns: a.closes_ns.max(b.closes_ns),
        });
        if joined.off_ns - joined.on_ns < min_on_time_ns {
            return None;
        }
        valve.pulses.retain(|p| !touches(p));
        valve.pulses.push(joined);
        self.next_edge_ns = now_ns;
        Some(joined)
    }

    /// Switches every valve's driver off at `at_ns`, not before now.
    pub fn close_all(&mut self, at_ns: i64, closing_delay_ns: impl Fn(usize) -> i64, now_ns: i64) {
        for j in 0..self.valves.len() {
            self.close(j, at_ns, closing_delay_ns(j), now_ns);
        }
    }

    /// Switches one valve's driver off at `at_ns`, not before now.
    pub fn close(&mut self, jet: usize, at_ns: i64, closing_delay_ns: i64, now_ns: i64) {
        let Some(valve) = self.valves.get_mut(jet) else { return };
        valve.pulses.retain(|pulse| pulse.on_ns < at_ns);
        for pulse in &mut valve.pulses {
            if pulse.off_ns > at_ns {
                pulse.off_ns = at_ns;
                pulse.closes_ns = at_ns + closing_delay_ns;
            }
        }
        self.next_edge_ns = now_ns;
    }

    /// Does from now on what the valves of other jets do.
    pub fn take_over(&mut self, other: &Self, now_ns: i64) {
        for (valve, of) in self.valves.iter_mut().zip(&other.valves) {
            valve.pulses.clone_from(&of.pulses);
            (valve.failure, valve.driven_ns, valve.open_ns) = (of.failure, of.driven_ns, of.open_ns);
            (valve.is_open, valve.flow) = (of.is_open, of.flow);
        }
        (self.lag, self.since_ns) = (other.lag, other.since_ns);
        self.settle(now_ns);
    }

    /// Lets each jet give this share of its thrust, whatever its valve does, until it takes over what another's does.
    pub fn blow(&mut self, shares: &[f64]) {
        (self.target, self.lacking, self.next_edge_ns) = (NOTHING, NOTHING, i64::MAX);
        for (valve, share) in self.valves.iter().zip(shares).filter(|(_, share)| **share != 0.0) {
            self.target.add(valve, *share);
        }
    }

    pub fn fail(&mut self, jet: usize, failure: JetFailure, now_ns: i64) -> bool {
        let Some(valve) = self.valves.get_mut(jet) else { return false };
        valve.failure = failure;
        self.settle(now_ns);
        true
    }

    /// Another torque of a jet from now on, body axes [N m].
    pub fn set_torque(&mut self, jet: usize, torque_b_n_m: Vector3<f64>, now_ns: i64) {
        if let Some(valve) = self.valves.get_mut(jet).filter(|valve| valve.torque_b_n_m != torque_b_n_m) {
            valve.torque_b_n_m = torque_b_n_m;
            self.settle(now_ns);
        }
    }

    pub fn failure(&self, jet: usize) -> JetFailure {
        self.valves.get(jet).map_or(JetFailure::None, |valve| valve.failure)
    }

    /// When [`Self::settle`] must be called next \[ns\].
    #[inline]
    pub fn next_edge_ns(&self) -> i64 {
        self.next_edge_ns
    }

    /// Opens and closes what is due at `now_ns`.
    pub fn settle(&mut self, now_ns: i64) {
        let elapsed_ns = now_ns - self.since_ns;
        self.since_ns = now_ns;
        self.target = NOTHING;
        self.lacking = NOTHING;
        for valve in &mut self.valves {
            valve.flow = self.lag.fraction(valve.flow, valve.is_open, elapsed_ns as f64 * 1e-9);
            valve.open_ns += if valve.is_open { elapsed_ns } else { 0 };
            let driven_ns = &mut valve.driven_ns;
            valve.pulses.retain(|pulse| {
                // A pulse that ends just now may yet be prolonged.
                let over = pulse.off_ns < now_ns && pulse.closes_ns < now_ns;
                *driven_ns += if over { pulse.off_ns - pulse.on_ns } else { 0 };
                !over
            });
            valve.is_open = match valve.failure {
                JetFailure::StuckClosed => false,
                JetFailure::StuckOpen => true,
                JetFailure::None => valve.pulses.iter().any(|p| p.opens_ns <= now_ns && now_ns < p.closes_ns),
            };
            if valve.is_open {
                self.target.add(valve, 1.0);
                self.lacking.add(valve, 1.0 - valve.flow);
            }
        }
        let edges =
            self.valves.iter().flat_map(|valve| &valve.pulses).flat_map(|p| [p.opens_ns, p.closes_ns]);
        self.next_edge_ns = edges.filter(|&edge| edge > now_ns).min().unwrap_or(i64::MAX);
    }

    /// The jets `elapsed_s` after `now_ns`, with no edge since the last [`Self::settle`].
    #[inline]
    pub fn drive(&self, now_ns: i64, elapsed_s: f64) -> JetDrive {
        if self.lag.is_none() {
            return self.target;
        }
        let since_s = (now_ns - self.since_ns) as f64 * 1e-9 + elapsed_s;
        // Shortfall of one jet after a start from zero.
        let missing = 1.0 - self.lag.fraction(0.0, true, since_s);
        let mut drive = JetDrive {
            torque_b_n_m: self.target.torque_b_n_m - self.lacking.torque_b_n_m * missing,
            thrust_n: self.target.thrust_n - self.lacking.thrust_n * missing,
        };
        for valve in self.valves.iter().filter(|valve| !valve.is_open && valve.flow > 0.0) {
            drive.add(valve, self.lag.fraction(valve.flow, false, since_s));
        }
        drive
    }

    /// 1 for each open valve.
    pub fn fractions(&self) -> [f64; MAX_JETS] {
        let mut fractions = [0.0; MAX_JETS];
        for (fraction, valve) in fractions.iter_mut().zip(&self.valves) {
            *fraction = f64::from(u8::from(valve.is_open));
        }
        fractions
    }

    /// Time the valve's driver has been on since the start \[ns\].
    pub fn driven_ns(&self, jet: usize, now_ns: i64) -> i64 {
        self.valves.get(jet).map_or(0, |valve| {
            let so_far = |p: &Pulse| (now_ns.min(p.off_ns) - p.on_ns).max(0);
            valve.driven_ns + valve.pulses.iter().map(so_far).sum::<i64>()
        })
    }

    /// Time the valve has really been open since the start \[ns\].
    pub fn open_ns(&self, jet: usize, now_ns: i64) -> i64 {
        self.valves
            .get(jet)
            .map_or(0, |valve| valve.open_ns + if valve.is_open { now_ns - self.since_ns } else { 0 })
    }
}
