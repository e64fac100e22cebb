//! A recording in place of hardware.
//!
//! Measurements come out on the same topics, with the same spacing in time, shifted so that the
//! recording's first message falls on the driver's start. Commands are accepted and have no effect:
//! the recorded motion cannot be changed.

use std::time::Duration;

use whorl_msgs::topics::{Message, Topic};
use whorl_node::Timestamp;

use crate::gate::Action;
use crate::hardware::{Hardware, Status};

/// One recorded measurement and its own time.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedMeasurement {
    /// When it was measured, on the recording's clock.
    pub stamp: Timestamp,
    /// The topic it belongs on.
    pub topic: Topic,
    /// The message, with the recording's stamp in its header.
    pub message: Message,
}

/// Plays a recording back.
#[derive(Debug, Clone)]
pub struct Replay {
    source: String,
    /// In order of time.
    recording: Vec<RecordedMeasurement>,
    next: usize,
    start: Option<Timestamp>,
}

impl Replay {
    /// Plays `recording` back; `source` names it in diagnostics.
    #[must_use]
    pub fn new(source: impl Into<String>, mut recording: Vec<RecordedMeasurement>) -> Self {
        // Recordings are in order of arrival; replay is in order of measurement.
        recording.sort_by_key(|m| m.stamp);
        Self { source: source.into(), recording, next: 0, start: None }
    }
}

impl Hardware for Replay {
    fn advance_to(&mut self, now: Timestamp) {
        self.start.get_or_insert(now);
    }

    fn apply(&mut self, _now: Timestamp, _action: &Action) {}

    fn measurements(&mut self, now: Timestamp, frame_id: &str, out: &mut Vec<(Topic, Message)>) {
        let start = *self.start.get_or_insert(now);
        let Some(first) = self.recording.first().map(|m| m.stamp) else { return };
        while let Some(measurement) = self.recording.get(self.next) {
            let offset_ns = measurement.stamp.0.saturating_sub(first.0);
            let stamp = start + Duration::from_nanos(u64::try_from(offset_ns).unwrap_or(0));
            if stamp > now {
                break;
            }
            let mut message = measurement.message.clone();
            restamp(&mut message, stamp, frame_id);
            out.push((measurement.topic, message));
            self.next += 1;
        }
    }

    fn status(&self) -> Status {
        let (next, all) = (self.next, self.recording.len());
        let text = format!("replaying {}: {next} of {all} measurements sent", self.source);
        Status { warning: next == all, text }
    }

    fn ended(&self) -> bool {
        self.next == self.recording.len()
    }
}

fn restamp(message: &mut Message, stamp: Timestamp, frame_id: &str) {
    let header = match message {
        Message::Imu(m) => &mut m.header,
        Message::Vector3Stamped(m) => &mut m.header,
        Message::JointState(m) => &mut m.header,
        Message::ThrusterState(m) => &mut m.header,
        Message::BatteryState(m) => &mut m.header,
        Message::FluidPressure(m) => &mut m.header,
        Message::Temperature(m) => &mut m.header,
        // The frame of the truth is the world.
        Message::AttitudeEstimate(m) => {
            m.header.stamp = stamp.into();
            return;
        }
        _ => return,
    };
    header.stamp = stamp.into();
    header.frame_id.clear();
    header.frame_id.push_str(frame_id);
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_msgs::sensor_msgs::Imu;

    #[test]
    fn a_recording_keeps_its_spacing_and_starts_now() {
        let at = |ms: i64| Timestamp(ms * 1_000_000);
        let imu = |ms: i64, x: f64| RecordedMeasurement {
            stamp: at(ms),
            topic: Topic::ImuRaw,
            message: Imu { angular_velocity: [x, 0.0, 0.0].into(), ..Imu::default() }.into(),
        };
        // Arrived out of order.
        let mut replay = Replay::new("test", vec![imu(5_000, 0.0), imu(5_020, 2.0), imu(5_010, 1.0)]);
        let mut out = Vec::new();
        let mut sent = Vec::new();
        for now in [100, 109, 110, 125] {
            replay.advance_to(at(now));
            replay.measurements(at(now), "p/base_link", &mut out);
            for (_, message) in out.drain(..) {
                let Message::Imu(m) = message else { panic!() };
                assert_eq!(m.header.frame_id, "p/base_link");
                sent.push((now, Timestamp::from(m.header.stamp), m.angular_velocity.x));
            }
        }
        assert_eq!(sent, [(100, at(100), 0.0), (110, at(110), 1.0), (125, at(120), 2.0)]);
        assert!(replay.ended());
    }
}
