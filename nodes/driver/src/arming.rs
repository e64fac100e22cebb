//! Whether the platform may move.
//!
//! ```text
//!   waiting ──(every device answers)──► armed ◄──(whorl arm, every device answers)── disarmed
//!                                         └──────────────(whorl disarm)──────────────►──┘
//! ```
//!
//! What is simulated begins armed, emulated devices begin waiting, real ones disarmed, whatever a file says.

use crate::parameters::Backend;

/// The state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arming {
    /// Commands are refused.
    Disarmed,
    /// Armed as soon as the devices answer.
    Waiting,
    /// Commands are obeyed.
    Armed,
}

impl Arming {
    /// At the start of a driver with this backend.
    #[must_use]
    pub fn new(asked: bool, backend: &Backend) -> Self {
        match backend {
            Backend::Hardware { root: None } => Self::Disarmed,
            _ if !asked => Self::Disarmed,
            Backend::Hardware { root: Some(_) } => Self::Waiting,
            Backend::Simulated { .. } | Backend::Replay { .. } => Self::Armed,
        }
    }

    /// Whether commands are obeyed.
    #[must_use]
    pub fn is_armed(self) -> bool {
        self == Self::Armed
    }

    /// For people.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Waiting => "waiting for devices",
            Self::Armed => "armed",
        }
    }

    /// Arms what waits once nothing is missing. What to tell, when it was armed.
    pub fn look(&mut self, not_ready: impl FnOnce() -> Vec<String>) -> Option<&'static str> {
        if *self != Self::Waiting || !not_ready().is_empty() {
            return None;
        }
        *self = Self::Armed;
        Some("armed")
    }

    /// A person asks for it.
    ///
    /// # Errors
    /// What is not ready; nothing changes.
    pub fn ask(&mut self, armed: bool, not_ready: impl FnOnce() -> Vec<String>) -> Result<(), String> {
        if !armed {
            *self = Self::Disarmed;
        } else if *self == Self::Disarmed {
            let reasons = not_ready();
            if !reasons.is_empty() {
                return Err(format!("not armed: {}", reasons.join("; ")));
            }
            *self = Self::Armed;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_devices_are_armed_by_a_person_and_only_when_they_answer() {
        let mut arming = Arming::new(true, &Backend::Hardware { root: None });
        assert_eq!(arming.look(Vec::new), None);
        assert!(!arming.is_armed());
        let refusal = arming.ask(true, || vec!["device imu is lost".into()]).unwrap_err();
        assert!(refusal.contains("imu") && !arming.is_armed());
        arming.ask(true, Vec::new).unwrap();
        assert!(arming.is_armed());
        arming.ask(false, || unreachable!()).unwrap();
        assert!(!arming.is_armed() && arming.look(Vec::new).is_none());
    }

    #[test]
    fn what_is_emulated_arms_itself_once_it_is_ready() {
        let emulated = Backend::Hardware { root: Some("/tmp".into()) };
        let mut arming = Arming::new(true, &emulated);
        assert_eq!(arming.look(|| vec!["device imu has not answered yet".into()]), None);
        assert!(arming.look(Vec::new).is_some() && arming.is_armed());
        let recording = Backend::Replay { source: "a".into(), channels: None };
        assert!(Arming::new(true, &recording).is_armed() && !Arming::new(false, &recording).is_armed());
        assert_eq!(Arming::new(false, &emulated).look(Vec::new), None);
    }
}
