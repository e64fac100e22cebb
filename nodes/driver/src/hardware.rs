//! What a driver drives: simulated hardware, a recording, or real hardware.

use nalgebra::Vector3;
use whorl_msgs::topics::{Message, Topic};
use whorl_node::Timestamp;

use crate::faults::Fault;
use crate::gate::Action;

/// One platform's actuators and sensors.
pub trait Hardware: Send {
    /// Advances simulated hardware to `now`. Real hardware does nothing here.
    fn advance_to(&mut self, now: Timestamp);

    /// The driver runs. Called at every tick, which is what the watchdog of the valve board waits for: hardware passes it
    /// on as an edge of its heartbeat line.
    fn heartbeat(&mut self, _now: Timestamp) {}

    /// Executes the gate's decision, now.
    fn apply(&mut self, now: Timestamp, action: &Action);

    /// Moves the linear mass actuators: moment to add to the gravity offset from now on, body axes [N m],
    /// finite. Hardware without them ignores it.
    fn move_ballast(&mut self, _now: Timestamp, _moment_b_n_m: Vector3<f64>) {}

    /// Measurements due by `now`, stamped, in order of time.
    fn measurements(&mut self, now: Timestamp, frame_id: &str, out: &mut Vec<(Topic, Message)>);

    /// One sentence on its state, and whether something is wrong, for diagnostics.
    fn status(&self) -> Status;

    /// Why it is not ready to be armed, a sentence each.
    fn not_ready(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether the emergency stop is pressed: the platform is disarmed.
    fn is_stopped(&self) -> bool {
        false
    }

    /// Name of a device that is lost without which the platform must not move.
    fn lost_needed(&self) -> Option<String> {
        None
    }

    /// What has happened since the last call: whether it is a warning, and a sentence.
    fn take_news(&mut self) -> Vec<(bool, String)> {
        Vec::new()
    }

    /// Changes the injected faults; only simulated hardware supports them.
    fn set_faults(&mut self, _faults: &[Fault]) {}

    /// Whether there is nothing left to drive (a recording has ended).
    fn ended(&self) -> bool {
        false
    }
}

/// State of the hardware in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// Whether a person should look at it.
    pub warning: bool,
    /// One sentence.
    pub text: String,
}
