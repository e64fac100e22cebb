//! The safety gate between commands and actuators, the same for every backend.
//!
//! It runs in the driver's own process, so that valves close and wheels coast whatever happens to
//! the rest of the system. A command holds until its `valid_until`, and never longer than
//! [`LONGEST_VALIDITY`] after its arrival.

use std::ops::Range;
use std::time::Duration;

use whorl_dynamics::actuators::{Actuators, Kind, Motor};
use whorl_msgs::whorl::ActuatorCommand;
use whorl_node::Timestamp;

/// Everything is off 100 ms after the last command was sent. This value is smaller, to allow for the link delay,
/// the driver's tick, and scheduling delays of a busy computer.
pub const LONGEST_VALIDITY: Duration = Duration::from_millis(80);

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
    /// Negative on-time, or a slot length that is not positive.
    OutOfRange,
    /// Not newer than the latest accepted command.
    OutOfOrder,
    /// Its validity ended before it arrived.
    Expired,
}

impl Refusal {
    /// For the log.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::WrongSize => "its number of wheels or jets is not the platform's",
            Self::NotFinite => "a value is not finite",
            Self::OutOfRange => "an on-time is negative or the slot length is not positive",
            Self::OutOfOrder => "it is not newer than the latest accepted command",
            Self::Expired => "its validity ended before it arrived",
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
    counts: GateCounts,
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
    slot: Option<u64>,
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
            counts: GateCounts::default(),
        }
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

    /// Takes a command that arrived now.
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
                Err(refusal)
            }
        }
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
        if command.jet_on_time_s.iter().any(|t| *t < 0.0) || !(slot_s > 0.0 && slot_s.is_finite()) {
            return Err(Refusal::OutOfRange);
        }
        let stamp = Timestamp::from(command.header.stamp);
        let ends = Timestamp::from(command.valid_until).min(now + LONGEST_VALIDITY);
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
        let slot_seen = if restarted { None } else { self.latest.and_then(|l| l.slot) };

        let clipped = |motors: &Motors| {
            let limited = asked(motors).iter().zip(&motors.limits).map(|(u, limit)| u.clamp(-limit, *limit));
            Action::Motors(motors.kind, limited.collect())
        };
        let mut actions: Vec<Action> = self.motors.iter().map(clipped).collect();
        if slot_seen.is_none_or(|seen| command.jet_slot > seen) {
            actions.push(Action::Pulses(command.jet_on_time_s.iter().map(|t| t.min(slot_s)).collect()));
        }
        self.latest = Some(Latest {
            stamp,
            sequence: command.sequence,
            slot: Some(slot_seen.map_or(command.jet_slot, |seen| seen.max(command.jet_slot))),
            ends: Some(ends),
        });
        Ok(actions)
    }

    /// Switches everything off if the commands' validity has ended; call at least every 10 ms.
    pub fn watch(&mut self, now: Timestamp) -> Option<Action> {
        let latest = self.latest.as_mut()?;
        latest.ends.filter(|ends| *ends <= now)?;
        latest.ends = None;
        self.counts.timeouts += 1;
        Some(Action::AllOff)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_dynamics::PlatformModel;
    use whorl_msgs::std_msgs::Header;

    fn at(ms: i64) -> Timestamp {
        Timestamp(ms * 1_000_000)
    }

    fn command(sequence: u64, stamp_ms: i64, valid_ms: i64, slot: u64) -> ActuatorCommand {
        ActuatorCommand {
            header: Header { stamp: at(stamp_ms).into(), frame_id: String::new() },
            sequence,
            valid_until: at(valid_ms).into(),
            wheel_torque_n_m: vec![0.1, -9.0],
            jet_slot: slot,
            jet_slot_length_s: 0.1,
            jet_on_time_s: vec![0.02, 0.5],
        }
    }

    fn gate() -> Gate {
        let mut model = PlatformModel::whorl_1_reference();
        model.wheels_mut().truncate(2);
        model.jets_mut().truncate(2);
        Gate::new(&model.actuators)
    }

    #[test]
    fn wheels_follow_every_command_and_a_slot_fires_once() {
        let mut gate = gate();
        let wheels = Action::Motors(Kind::Wheels, vec![0.1, -0.5]);
        let pulses = Action::Pulses(vec![0.02, 0.1]);
        assert_eq!(gate.command(at(1), &command(0, 0, 60, 4)), Ok(vec![wheels.clone(), pulses.clone()]));
        assert_eq!(gate.command(at(11), &command(1, 10, 70, 4)), Ok(vec![wheels.clone()]));
        // The first command of slot 5 was lost: the second one fires it.
        assert_eq!(gate.command(at(31), &command(3, 30, 90, 5)), Ok(vec![wheels, pulses]));
    }

    #[test]
    fn silence_switches_everything_off_once_at_the_end_of_validity() {
        let mut gate = gate();
        gate.command(at(1), &command(0, 0, 60, 0)).unwrap();
        assert_eq!(gate.deadline(), Some(at(60)));
        assert_eq!(gate.watch(at(59)), None);
        assert_eq!(gate.watch(at(60)), Some(Action::AllOff));
        assert_eq!(gate.watch(at(61)), None);
        assert_eq!(gate.counts().timeouts, 1);
    }

    #[test]
    fn no_command_holds_longer_than_a_tenth_of_a_second() {
        let mut gate = gate();
        gate.command(at(1), &command(0, 0, 3_600_000, 0)).unwrap();
        assert_eq!(gate.watch(at(80)), None);
        assert_eq!(gate.watch(at(81)), Some(Action::AllOff));
    }

    #[test]
    fn bad_commands_are_refused_and_change_nothing() {
        let mut gate = gate();
        gate.command(at(1), &command(5, 0, 60, 0)).unwrap();
        let mut nan = command(6, 10, 70, 1);
        nan.wheel_torque_n_m[0] = f64::NAN;
        let mut short = command(6, 10, 70, 1);
        short.jet_on_time_s.pop();
        let mut negative = command(6, 10, 70, 1);
        negative.jet_on_time_s[0] = -0.01;
        assert_eq!(gate.command(at(11), &nan), Err(Refusal::NotFinite));
        assert_eq!(gate.command(at(11), &short), Err(Refusal::WrongSize));
        assert_eq!(gate.command(at(11), &negative), Err(Refusal::OutOfRange));
        assert_eq!(gate.command(at(11), &command(5, 0, 70, 1)), Err(Refusal::OutOfOrder));
        assert_eq!(gate.command(at(80), &command(6, 10, 70, 1)), Err(Refusal::Expired));
        assert_eq!(gate.deadline(), Some(at(60)));
        assert_eq!(gate.counts(), GateCounts { accepted: 1, refused: 5, timeouts: 0 });
    }

    #[test]
    fn a_restarted_sender_is_obeyed_at_once() {
        let mut gate = gate();
        gate.command(at(1), &command(500, 0, 60, 50)).unwrap();
        let actions = gate.command(at(211), &command(0, 210, 270, 0)).unwrap();
        assert_eq!(actions.len(), 2, "its first slot fires although its counter is smaller");
    }
}
