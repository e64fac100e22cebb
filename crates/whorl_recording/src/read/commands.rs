//! Reconstructs how the driver executed the commands sent to it.
//!
//! The rules are those of the driver's gate: a command holds until the next, at most until its
//! `valid_until` and never longer than 0.1 s, or 0.2 s where traffic was secured; then everything is off. A jet slot fires once, at the first
//! command that carries it.

use whorl_msgs::whorl::ActuatorCommand;
use whorl_node::Timestamp;

use crate::columns::Columns;

/// As the driver's gate.
const LONGEST_VALIDITY_NS: i64 = 100_000_000;
/// What local control says a command holds for where traffic is secured: 0.06 s and a stall of 0.1 s (`SECURED_STALL`). Nobody who sends in
/// the open says that: 0.1 s is the most that local control may, and who commands by hand says much more.
const SECURED_VALIDITY_NS: std::ops::RangeInclusive<i64> = 110_000_000..=200_000_000;

/// Commands and when they reached the driver: what decides what wheels and jets do. An hour has hundreds of thousands,
/// whose numbers stand in one list.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Commands {
    list: Vec<Sent>,
    numbers: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq)]
struct Sent {
    at_ns: i64,
    stamp: Timestamp,
    valid_until: Timestamp,
    sequence: u64,
    jet_slot: u64,
    jet_slot_length_s: f64,
    /// Where its numbers begin: torques of the wheels, then on-times of the jets, which are left out where none fires,
    /// as in most commands.
    first: usize,
    wheels: u32,
    jets: u32,
    fires: bool,
}

impl Commands {
    /// Adds a command that reached the driver then.
    pub fn push(&mut self, at_ns: i64, command: &ActuatorCommand) {
        let fires = command.jet_on_time_s.iter().any(|t| *t != 0.0);
        // Messages of more numbers than this are none.
        let count = |list: &[f64]| u32::try_from(list.len()).unwrap_or(u32::MAX);
        self.list.push(Sent {
            at_ns,
            stamp: command.header.stamp.into(),
            valid_until: command.valid_until.into(),
            sequence: command.sequence,
            jet_slot: command.jet_slot,
            jet_slot_length_s: command.jet_slot_length_s,
            first: self.numbers.len(),
            wheels: count(&command.wheel_torque_n_m),
            jets: count(&command.jet_on_time_s),
            fires,
        });
        self.numbers.extend_from_slice(&command.wheel_torque_n_m);
        if fires {
            self.numbers.extend_from_slice(&command.jet_on_time_s);
        }
    }

    pub fn len(&self) -> usize {
        self.list.len()
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Brings them into the order of their arrival.
    pub fn sort(&mut self) {
        self.list.sort_by_key(|sent| sent.at_ns);
    }

    /// Torques of the wheels, and on-times of the jets: empty where none fires.
    fn numbers(&self, sent: &Sent) -> (&[f64], &[f64]) {
        let from = self.numbers.get(sent.first..).unwrap_or_default();
        let (torques, rest) = from.split_at_checked(sent.wheels as usize).unwrap_or_default();
        let jets = if sent.fires { sent.jets as usize } else { 0 };
        (torques, rest.get(..jets).unwrap_or_default())
    }
}

/// A pulse, switched on and off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PulseNs {
    pub on_ns: i64,
    pub off_ns: i64,
}

/// Actuator inputs that result from a sequence of commands.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Applied {
    /// Motor torques [N m] and since when.
    pub wheel_torque_n_m: Columns,
    /// Pulses of each jet, in order of time, apart from each other.
    pub pulses: Vec<Vec<PulseNs>>,
    /// Commands that the driver would have refused.
    pub refused: usize,
}

/// Limits of the platform that change what is done; without a model nothing is clipped.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Limits {
    /// Largest motor torque of each wheel [N m].
    pub wheel_torque_n_m: Vec<f64>,
    /// Shortest pulse of each jet \[s\].
    pub min_on_time_s: Vec<f64>,
}

struct Latest {
    stamp: Timestamp,
    sequence: u64,
    slot: u64,
    ends_ns: i64,
}

/// Follows the commands, which are in order of arrival.
pub(super) fn apply(sent: &Commands, limits: &Limits) -> Applied {
    let mut applied = Applied::default();
    let Some(first) = sent.list.first() else { return applied };
    let (wheels, jets) = (first.wheels as usize, first.jets);
    applied.pulses = vec![Vec::new(); jets as usize];
    let mut latest: Option<Latest> = None;
    let mut torques: Vec<f64> = Vec::with_capacity(wheels);
    for command in &sent.list {
        let at_ns = command.at_ns;
        let (wheel_torque_n_m, jet_on_time_s) = sent.numbers(command);
        if let Some(before) = latest.as_ref().filter(|before| before.ends_ns <= at_ns) {
            applied.all_off(before.ends_ns, wheels);
        }
        let stamp = command.stamp;
        let valid_ns = command.valid_until.0.saturating_sub(stamp.0);
        let longest_ns = if SECURED_VALIDITY_NS.contains(&valid_ns) { valid_ns } else { LONGEST_VALIDITY_NS };
        let ends_ns = command.valid_until.0.min(at_ns.saturating_add(longest_ns));
        let numbers = wheel_torque_n_m.iter().chain(jet_on_time_s);
        let obeyed = wheel_torque_n_m.len() == wheels
            && command.jets == jets
            && numbers.copied().all(f64::is_finite)
            && jet_on_time_s.iter().all(|t| *t >= 0.0)
            && command.jet_slot_length_s > 0.0
            && ends_ns > at_ns
            && latest
                .as_ref()
                .is_none_or(|l| stamp > l.stamp || (stamp == l.stamp && command.sequence > l.sequence));
        if !obeyed {
            applied.refused += 1;
            // A valid command stays valid; an expired one stays off.
            if let Some(before) = latest.as_mut().filter(|before| before.ends_ns <= at_ns) {
                before.ends_ns = i64::MAX;
            }
            continue;
        }
        let limit = |j: usize| limits.wheel_torque_n_m.get(j).copied().unwrap_or(f64::INFINITY);
        torques.clear();
        torques.extend(wheel_torque_n_m.iter().enumerate().map(|(j, u)| u.max(-limit(j)).min(limit(j))));
        applied.wheel_torque_n_m.push(at_ns, &torques);
        let restarted = latest.as_ref().is_some_and(|l| command.sequence <= l.sequence);
        let seen = latest.as_ref().filter(|_| !restarted).map(|l| l.slot);
        if seen.is_none_or(|seen| command.jet_slot > seen) {
            for (jet, (pulses, on_time_s)) in applied.pulses.iter_mut().zip(jet_on_time_s).enumerate() {
                let on_time_s = on_time_s.min(command.jet_slot_length_s);
                if on_time_s > 0.0 && on_time_s >= limits.min_on_time_s.get(jet).copied().unwrap_or(0.0) {
                    let off_ns = at_ns.saturating_add((on_time_s * 1e9).round() as i64);
                    add(pulses, PulseNs { on_ns: at_ns, off_ns });
                }
            }
        }
        let slot = seen.map_or(command.jet_slot, |seen| seen.max(command.jet_slot));
        latest = Some(Latest { stamp, sequence: command.sequence, slot, ends_ns });
    }
    if let Some(last) = latest.filter(|last| last.ends_ns < i64::MAX) {
        applied.all_off(last.ends_ns, wheels);
    }
    applied
}

impl Applied {
    fn all_off(&mut self, at_ns: i64, wheels: usize) {
        self.wheel_torque_n_m.push(at_ns, &vec![0.0; wheels]);
        for pulses in &mut self.pulses {
            // The others ended before the last began.
            if let Some(last) = pulses.last_mut() {
                last.off_ns = last.off_ns.min(at_ns);
            }
            pulses.pop_if(|pulse| pulse.off_ns <= pulse.on_ns);
        }
    }
}

/// Adds a pulse; one that begins before the last one ends prolongs it.
pub(super) fn add(pulses: &mut Vec<PulseNs>, pulse: PulseNs) {
    match pulses.last_mut() {
        Some(last) if pulse.on_ns <= last.off_ns => last.off_ns = last.off_ns.max(pulse.off_ns),
        _ if pulse.off_ns > pulse.on_ns => pulses.push(pulse),
        _ => {}
    }
}
