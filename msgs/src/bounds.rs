//! Bounds of what any message may hold: the door. A message outside them is refused before a node's core sees it.
//!
//! A bound is far beyond what a laboratory can send and far inside what arithmetic can take: nothing that passes
//! overflows a duration, a counter or a square. NaN and infinity pass, since definitions give them a meaning
//! ("unknown"): the cores refuse them where a number is needed.

use std::fmt;

use crate::builtin_interfaces::Time;
use crate::fields::Visitor;
use crate::topics::Message;

/// Largest magnitude of a finite number, by the end of the name of its field or, for a component, of the vector or
/// quaternion that it belongs to. The first that fits holds.
const LARGEST: &[(&str, f64)] = &[
    ("jet_slot_length_s", LONGEST_SLOT_S),
    ("jet_on_time_s", LONGEST_SLOT_S),
    // A command clips to what a motor can do; a value beyond this is not a torque.
    ("wheel_torque_n_m", 1e6),
    ("rad_s2", 1e6),
    ("rad_s", 1e6),
    ("rad", 1e3),
    ("n_m", 1e6),
    // Times and ages: thirty years.
    ("_s", 1e9),
];
/// Longest slot of the jets \[s\].
const LONGEST_SLOT_S: f64 = 60.0;
/// Of all other numbers; covariances of an estimator that has just begun are the largest.
const LARGEST_NUMBER: f64 = 1e12;
/// Largest counter: a million messages a second for 285 years.
const LARGEST_COUNT: u64 = 1 << 53;
/// Counters of messages, slots and events.
const COUNTERS: [&str; 2] = ["sequence", "jet_slot"];
/// Longest sequence of elements: platforms, wheels, jets, parameters, entries of `/diagnostics`.
pub const LONGEST_SEQUENCE: usize = 256;
/// Longest text, in bytes.
pub const LONGEST_TEXT: usize = 4096;

/// The first field of a message that is outside its bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct OutOfBounds {
    /// The field, with those that it is in: `header.stamp`.
    pub field: String,
    /// What it holds.
    pub value: String,
    /// What it may hold.
    pub allowed: String,
}

impl fmt::Display for OutOfBounds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {}; allowed: {}", self.field, self.value, self.allowed)
    }
}

impl std::error::Error for OutOfBounds {}

impl Message {
    /// Whether every field is within its bounds. The message is not changed.
    ///
    /// # Errors
    /// The first field that is not.
    pub fn check_bounds(&mut self) -> Result<(), OutOfBounds> {
        let mut check = Check::default();
        self.walk(&mut check);
        check.found.map_or(Ok(()), Err)
    }
}

#[derive(Default)]
struct Check {
    within: Vec<&'static str>,
    found: Option<OutOfBounds>,
}

impl Check {
    fn refuse(&mut self, name: &'static str, value: impl fmt::Display, allowed: String) {
        if self.found.is_none() {
            let path = self.within.iter().copied().filter(|part| !part.is_empty()).chain([name]);
            let field = path.collect::<Vec<_>>().join(".");
            self.found = Some(OutOfBounds { field, value: value.to_string(), allowed });
        }
    }

    /// By the field's own name, or by that of the nearest field around it that tells a unit.
    fn largest(&self, name: &'static str) -> f64 {
        let names = std::iter::once(name).chain(self.within.iter().rev().copied());
        let bound =
            |name: &str| LARGEST.iter().find(|(end, _)| name.ends_with(end)).map(|(_, largest)| *largest);
        names.filter_map(bound).next().unwrap_or(LARGEST_NUMBER)
    }
}

impl Visitor for Check {
    fn enter(&mut self, name: &'static str) {
        self.within.push(name);
    }

    fn leave(&mut self) {
        self.within.pop();
    }

    fn real(&mut self, name: &'static str, value: &mut f64) {
        let largest = self.largest(name);
        if value.is_finite() && value.abs() > largest {
            self.refuse(name, format_args!("{value:e}"), format!("-{largest:e} to {largest:e}"));
        }
    }

    fn unsigned(&mut self, name: &'static str, value: &mut u64) {
        if COUNTERS.contains(&name) && *value > LARGEST_COUNT {
            self.refuse(name, *value, format!("at most {LARGEST_COUNT}"));
        }
    }

    fn text(&mut self, name: &'static str, value: &mut String) {
        if value.len() > LONGEST_TEXT {
            self.refuse(
                name,
                format_args!("{} bytes long", value.len()),
                format!("at most {LONGEST_TEXT} bytes"),
            );
        }
    }

    fn time(&mut self, name: &'static str, value: &mut Time) {
        if value.nanosec >= 1_000_000_000 {
            self.refuse(
                name,
                format_args!("{} ns after a second", value.nanosec),
                "below 1000000000 ns".to_owned(),
            );
        }
    }

    fn length(&mut self, name: &'static str, length: &mut usize) {
        if *length > LONGEST_SEQUENCE {
            self.refuse(name, format_args!("{length} long"), format!("at most {LONGEST_SEQUENCE} elements"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::MessageType;
    use crate::whorl::{ActuatorCommand, AttitudeEstimate};

    fn refused(message: impl Into<Message>) -> String {
        message.into().check_bounds().unwrap_err().to_string()
    }

    #[test]
    fn what_nodes_send_passes() {
        for &message_type in MessageType::ALL {
            assert_eq!(Message::default_of(message_type).check_bounds(), Ok(()), "{}", message_type.name());
        }
        let unknown = AttitudeEstimate { nis: f64::NAN, ..AttitudeEstimate::default() };
        assert_eq!(Message::from(unknown).check_bounds(), Ok(()));
        let command = ActuatorCommand {
            jet_slot_length_s: 0.1,
            jet_on_time_s: vec![0.02; 12],
            wheel_torque_n_m: vec![-0.5; 3],
            jet_slot: 1_000_000,
            ..ActuatorCommand::default()
        };
        assert_eq!(Message::from(command).check_bounds(), Ok(()));
    }

    #[test]
    fn what_no_duration_or_counter_can_take_is_refused_with_its_name() {
        let command = ActuatorCommand::default;
        assert_eq!(
            refused(ActuatorCommand { jet_slot_length_s: 1e20, ..command() }),
            "jet_slot_length_s is 1e20; allowed: -6e1 to 6e1"
        );
        assert!(
            refused(ActuatorCommand { jet_on_time_s: vec![0.0, 1e20], ..command() })
                .starts_with("jet_on_time_s")
        );
        assert!(
            refused(ActuatorCommand { jet_slot: u64::MAX, ..command() }).starts_with("jet_slot is 184467")
        );
        assert!(refused(ActuatorCommand { sequence: u64::MAX, ..command() }).starts_with("sequence"));
        assert!(
            refused(ActuatorCommand { jet_on_time_s: vec![0.0; 1_000_000], ..command() })
                .contains("1000000 long")
        );
        let mut late = command();
        late.header.stamp.nanosec = u32::MAX;
        assert!(refused(late).starts_with("header.stamp is 4294967295 ns"));
        let mut wordy = command();
        wordy.header.frame_id = "x".repeat(LONGEST_TEXT + 1);
        assert!(refused(wordy).starts_with("header.frame_id is 4097 bytes long"));
        let mut fast = AttitudeEstimate::default();
        fast.omega_wb_b_rad_s.y = -1e300;
        assert_eq!(refused(fast), "omega_wb_b_rad_s.y is -1e300; allowed: -1e6 to 1e6");
    }
}
