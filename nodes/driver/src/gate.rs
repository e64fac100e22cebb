//! The safety gate between commands and actuators, the same for every backend.
//!
//! It runs in the driver's own process, so that valves close and wheels coast whatever happens to
//! the rest of the system. A command holds until its `valid_until`, and never longer than
//! [`LONGEST_VALIDITY`] after its arrival, or [`Gate::secured`]. All deadlines are on the node's time, which nobody can set: see
//! [`whorl_node::NodeCore::step`].

use std::ops::Range;
use std::time::Duration;

use whorl_dynamics::actuators::{Actuators, Kind, Motor};
use whorl_msgs::whorl::{ActuatorCommand, GateState};
use whorl_node::{SECURED_STALL, Timestamp};

/// Everything is off 100 ms after the last command was sent. This value is smaller, to allow for the link delay,
/// the driver's tick, and scheduling delays of a busy computer.
pub const LONGEST_VALIDITY: Duration = Duration::from_millis(80);

/// Longest slot that is accepted \[s\]; pulses are clipped to it. Far beyond [`LONGEST_VALIDITY`], which ends every pulse.
const LONGEST_SLOT_S: f64 = 60.0;

/// A command may be stamped this far ahead of the driver's clock \[s\]: as far as clocks may differ without its validity
/// being over on arrival. A single stamp from the future would have every later command refused as older.
const AHEAD_S: f64 = 0.1;

/// A command to the actuators.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Commands of every motor of one kind of actuator, in the kind's unit.
    Motors(Kind, Vec<f64>),
    /// A new slot: open each jet's valve for this long from now \[s\]; zero closes it, even if the previous slot is
    /// not over.
    Pulses(Vec<f64>),
    /// Close all valves, all motor commands zero.
    AllOff,
}

/// Why a command was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// A number of motors or jets other than the platform's.
    WrongSize,
    /// NaN or infinite.
    NotFinite,
    /// Negative on-time, or a slot length that is not positive or too long.
    OutOfRange,
    /// Not newer than the latest accepted command.
    OutOfOrder,
    /// Its validity ended before it arrived.
    Expired,
    /// Stamped ahead of the driver's clock.
    Ahead,
}

impl Refusal {
    /// For the log.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::WrongSize => "its number of wheels or jets is not the platform's",
            Self::NotFinite => "a value is not finite",
            Self::OutOfRange => "an on-time is negative, or the slot length is not within 0 to 60 s",
            Self::OutOfOrder => "it is not newer than the latest accepted command",
            Self::Expired => "its validity ended before it arrived",
            Self::Ahead => "it is stamped more than 0.1 s ahead of this computer's clock",
        }
    }

    /// `GateState::REFUSAL_*`.
    #[must_use]
    pub fn code(self) -> u8 {
        match self {
            Self::WrongSize => GateState::REFUSAL_WRONG_SIZE,
            Self::NotFinite => GateState::REFUSAL_NOT_FINITE,
            Self::OutOfRange => GateState::REFUSAL_OUT_OF_RANGE,
            Self::OutOfOrder => GateState::REFUSAL_OUT_OF_ORDER,
            Self::Expired => GateState::REFUSAL_EXPIRED,
            Self::Ahead => GateState::REFUSAL_AHEAD,
        }
    }
}

/// Counters of the gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GateCounts {
    /// Commands carried out.
    pub accepted: u64,
    /// Commands refused.
    pub refused: u64,
    /// How often everything was switched off because no commands arrived.
    pub timeouts: u64,
}

/// The gate's state.
#[derive(Debug, Clone)]
pub struct Gate {
    jets: usize,
    motors: Vec<Motors>,
    latest: Option<Latest>,
    longest_validity: Duration,
    counts: GateCounts,
    last_refusal: Option<Refusal>,
    switched_off_late: Duration,
}

/// The motors of one kind of actuator.
#[derive(Debug, Clone)]
struct Motors {
    kind: Kind,
    /// Field of the command that holds their values.
    field: &'static str,
    /// Largest command of each; commands beyond are clipped.
    limits: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Latest {
    stamp: Timestamp,
    sequence: u64,
    slot: u64,
    /// When it arrived and was carried out.
    applied: Timestamp,
    /// End of validity; `None` after a timeout.
    ends: Option<Timestamp>,
}

impl Gate {
    /// A gate for a platform with these actuators.
    #[must_use]
    pub fn new(actuators: &Actuators) -> Self {
        let ranges = actuators.motor_ranges();
        let mut all = vec![Motor::default(); ranges.iter().map(Range::len).sum()];
        actuators.motors(&Default::default(), &[], &mut all);
        let motors = Kind::ALL.into_iter().zip(actuators.kinds()).zip(ranges);
        let motors = motors.filter_map(|((kind, row), range)| {
            let limits = all.get(range)?.iter().map(|motor| motor.limit).collect();
            Some(Motors { kind, field: row.channel()?.command_field, limits })
        });
        Self {
            jets: actuators.jets.list.len(),
            motors: motors.collect(),
            latest: None,
            longest_validity: LONGEST_VALIDITY,
            counts: GateCounts::default(),
            last_refusal: None,
            switched_off_late: Duration::ZERO,
        }
    }

    /// The same where traffic is secured: commands may hold for one stall of the DDS library longer, 180 ms, which is less than the
    /// 0.2 s after which the devices' own threads switch off.
    #[must_use]
    pub fn secured(self) -> Self {
        Self { longest_validity: LONGEST_VALIDITY + SECURED_STALL, ..self }
    }

    /// Counts so far.
    #[must_use]
    pub fn counts(&self) -> GateCounts {
        self.counts
    }

    /// When everything will be switched off unless a newer command arrives.
    #[must_use]
    pub fn deadline(&self) -> Option<Timestamp> {
        self.latest.and_then(|l| l.ends)
    }

    /// State, times and counts, without header and number.
    #[must_use]
    pub fn state(&self) -> GateState {
        let open = self.deadline();
        GateState {
            state: if open.is_some() { GateState::STATE_OBEYING } else { GateState::STATE_OFF },
            command_sequence: self.latest.map_or(0, |l| l.sequence),
            command_stamp: self.latest.map_or_else(Default::default, |l| l.stamp.into()),
            applied_at: self.latest.map_or_else(Default::default, |l| l.applied.into()),
            closes_at: open.map_or_else(Default::default, Into::into),
            switched_off_late_s: self.switched_off_late.as_secs_f64(),
            accepted: self.counts.accepted,
            refused: self.counts.refused,
            timeouts: self.counts.timeouts,
            refusal: self.last_refusal.map_or(GateState::REFUSAL_NONE, Refusal::code),
            ..GateState::default()
        }
    }

    /// Takes a command that arrived now, by the node's time.
    ///
    /// # Errors
    /// Why it was refused; then nothing changes.
    pub fn command(&mut self, now: Timestamp, command: &ActuatorCommand) -> Result<Vec<Action>, Refusal> {
        match self.examine(now, command) {
            Ok(actions) => {
                self.counts.accepted += 1;
                Ok(actions)
            }
            Err(refusal) => {
                self.counts.refused += 1;
                self.last_refusal = Some(refusal);
                Err(refusal)
            }
        }
    }

    /// Counts a command that was not looked at, because the platform must not move.
    pub fn ignore(&mut self) {
        self.counts.refused += 1;
    }

    fn examine(&mut self, now: Timestamp, command: &ActuatorCommand) -> Result<Vec<Action>, Refusal> {
        let asked = |motors: &Motors| command.motor_commands(motors.field).unwrap_or(&[]);
        if self.motors.iter().any(|motors| asked(motors).len() != motors.limits.len())
            || command.jet_on_time_s.len() != self.jets
        {
            return Err(Refusal::WrongSize);
        }
        let mut numbers = self.motors.iter().flat_map(asked).chain(&command.jet_on_time_s);
        if !numbers.all(|x| x.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        let slot_s = command.jet_slot_length_s;
        if command.jet_on_time_s.iter().any(|t| *t < 0.0) || !(slot_s > 0.0 && slot_s <= LONGEST_SLOT_S) {
            return Err(Refusal::OutOfRange);
        }
        let stamp = Timestamp::from(command.header.stamp);
        if stamp.seconds_since(now) > AHEAD_S {
            return Err(Refusal::Ahead);
        }
        let ends = Timestamp::from(command.valid_until).min(now + self.longest_validity);
        if ends <= now {
            return Err(Refusal::Expired);
        }
        // A sender that was restarted counts from zero again; its stamps still grow.
        if self
            .latest
            .is_some_and(|l| stamp < l.stamp || (stamp == l.stamp && command.sequence <= l.sequence))
        {
            return Err(Refusal::OutOfOrder);
        }
        let restarted = self.latest.is_some_and(|l| command.sequence <= l.sequence);
        // Commands are taken in order, so any other slot is a newer one. Its number may not be trusted to grow: a single
        // huge one would close the jets for good.
        let slot_seen = self.latest.filter(|_| !restarted).map(|l| l.slot);

        let clipped = |motors: &Motors| {
            let limited = asked(motors).iter().zip(&motors.limits).map(|(u, limit)| u.clamp(-limit, *limit));
            Action::Motors(motors.kind, limited.collect())
        };
        let there = self.motors.iter().filter(|motors| !motors.limits.is_empty());
        let mut actions: Vec<Action> = there.map(clipped).collect();
        if slot_seen != Some(command.jet_slot) {
            actions.push(Action::Pulses(command.jet_on_time_s.iter().map(|t| t.min(slot_s)).collect()));
        }
        self.latest = Some(Latest {
            stamp,
            sequence: command.sequence,
            slot: command.jet_slot,
            applied: now,
            ends: Some(ends),
        });
        Ok(actions)
    }

    /// Switches everything off if the commands' validity has ended by the node's time; call at least every 10 ms.
    pub fn watch(&mut self, now: Timestamp) -> Option<Action> {
        let latest = self.latest.as_mut()?;
        let ends = latest.ends.filter(|ends| *ends <= now)?;
        latest.ends = None;
        self.counts.timeouts += 1;
        self.switched_off_late =
            Duration::from_nanos(u64::try_from(now.0.saturating_sub(ends.0)).unwrap_or(0));
        Some(Action::AllOff)
    }

    /// Switches everything off now, whatever the commands' validity: the process is about to be unable to watch.
    pub fn close(&mut self) -> Action {
        if let Some(latest) = &mut self.latest {
            latest.ends = None;
        }
        Action::AllOff
    }
}

#[cfg(test)]
mod tests;
