//! Faults injected into simulated hardware, to test the system's responses.

use nalgebra::Vector3;
use whorl_msgs::sensor_msgs::Imu;
use whorl_params::{Reader, Span, non_negative, range};

/// What breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// Angular rates are NaN.
    GyroNan,
    /// Angular rates repeat the last good sample.
    GyroFrozen,
    /// Angular rates far beyond the gyro's range, as with a broken cable.
    GyroOutOfRange,
    /// Specific force is NaN.
    AccelerometerNan,
    /// No IMU messages.
    ImuSilent,
    /// The vector sensor's direction is NaN.
    VectorNan,
    /// No vector sensor messages.
    VectorSilent,
    /// The jet's valve stays closed.
    JetStuckClosed {
        /// Index of the jet.
        jet: usize,
    },
    /// The jet gives only this much of its thrust.
    JetWeak {
        /// Index of the jet.
        jet: usize,
        /// Thrust in per mille of its own.
        per_mille: u16,
    },
    /// The jet's valve stays open.
    JetStuckOpen {
        /// Index of the jet.
        jet: usize,
    },
}

/// A fault and the time in which it is active.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What breaks.
    pub kind: FaultKind,
    /// When, from the driver's start.
    pub span: Span,
}

impl Fault {
    /// Whether it is active at this time after the driver's start.
    #[must_use]
    pub fn active(&self, elapsed_s: f64) -> bool {
        self.span.contains(elapsed_s)
    }
}

const KINDS: [&str; 10] = [
    "gyro_nan",
    "gyro_frozen",
    "gyro_out_of_range",
    "accelerometer_nan",
    "imu_silent",
    "vector_nan",
    "vector_silent",
    "jet_stuck_closed",
    "jet_stuck_open",
    "jet_weak",
];

/// Reading of a gyro out of range [rad/s]; the range of MotionPak-class gyros is below 10 rad/s.
const IMPOSSIBLE_RATE_RAD_S: f64 = 100.0;

/// Reads the group `faults`: any number of faults under names of the user's choice.
pub(crate) fn read(r: &mut Reader<'_>, jets: &[String]) -> Vec<Fault> {
    r.children("faults")
        .iter()
        .map(|name| r.group("faults", |r| r.group(name, |r| read_fault(r, jets))))
        .collect()
}

fn read_fault(r: &mut Reader<'_>, jets: &[String]) -> Fault {
    let kind = r.choice("kind", &KINDS, "what breaks");
    let needs_jet = kind.starts_with("jet_");
    let jet_name = if needs_jet { r.string("jet", "name of the jet that breaks") } else { String::new() };
    let jet = jets.iter().position(|j| *j == jet_name);
    if needs_jet && jet.is_none() {
        r.reject("jet", format!("there is no such jet; allowed: {}", jets.join(", ")));
    }
    let jet = jet.unwrap_or(0);
    let weak = kind == "jet_weak";
    let thrust = if weak {
        r.f64("thrust", range(0.0..=2.0), "thrust of the jet over its own, as where a nozzle clogs")
    } else {
        1.0
    };
    Fault {
        kind: match kind {
            "gyro_nan" => FaultKind::GyroNan,
            "gyro_frozen" => FaultKind::GyroFrozen,
            "gyro_out_of_range" => FaultKind::GyroOutOfRange,
            "accelerometer_nan" => FaultKind::AccelerometerNan,
            "imu_silent" => FaultKind::ImuSilent,
            "vector_nan" => FaultKind::VectorNan,
            "vector_silent" => FaultKind::VectorSilent,
            "jet_stuck_open" => FaultKind::JetStuckOpen { jet },
            "jet_weak" => FaultKind::JetWeak { jet, per_mille: (thrust * 1000.0).round() as u16 },
            _ => FaultKind::JetStuckClosed { jet },
        },
        span: {
            let start_s = r.f64("start_s", non_negative(), "when it breaks, from the driver's start [s]");
            Span::from_start(r, start_s)
        },
    }
}

/// Applies the active faults to an IMU message; `false`: the message is not sent.
pub(crate) fn spoil_imu(
    message: &mut Imu,
    last_good_rate: &mut Option<Vector3<f64>>,
    active: impl Iterator<Item = FaultKind>,
) -> bool {
    let good_rate = Vector3::from(message.angular_velocity);
    let mut frozen = false;
    let mut sent = true;
    for kind in active {
        match kind {
            FaultKind::GyroNan => message.angular_velocity = Vector3::repeat(f64::NAN).into(),
            FaultKind::GyroOutOfRange => {
                message.angular_velocity = Vector3::repeat(IMPOSSIBLE_RATE_RAD_S).into()
            }
            FaultKind::AccelerometerNan => message.linear_acceleration = Vector3::repeat(f64::NAN).into(),
            FaultKind::GyroFrozen => {
                frozen = true;
                message.angular_velocity = last_good_rate.unwrap_or(good_rate).into();
            }
            FaultKind::ImuSilent => sent = false,
            FaultKind::VectorNan
            | FaultKind::VectorSilent
            | FaultKind::JetStuckClosed { .. }
            | FaultKind::JetWeak { .. }
            | FaultKind::JetStuckOpen { .. } => {}
        }
    }
    if !frozen || last_good_rate.is_none() {
        *last_good_rate = Some(good_rate);
    }
    sent
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frozen_gyro_repeats_its_last_good_sample_and_recovers() {
        let mut last = None;
        let mut rate = |x: f64, active: &[FaultKind]| {
            let mut imu = Imu { angular_velocity: [x, 0.0, 0.0].into(), ..Imu::default() };
            assert!(spoil_imu(&mut imu, &mut last, active.iter().copied()));
            imu.angular_velocity.x
        };
        let frozen = [FaultKind::GyroFrozen];
        assert_eq!(
            [rate(1.0, &[]), rate(2.0, &frozen), rate(3.0, &frozen), rate(4.0, &[])],
            [1.0, 1.0, 1.0, 4.0]
        );
        assert!(rate(5.0, &[FaultKind::GyroNan]).is_nan());
        assert!(rate(6.0, &[FaultKind::GyroOutOfRange]) > 10.0);
    }

    #[test]
    fn a_fault_is_there_from_its_start_for_its_length() {
        let fault = Fault { kind: FaultKind::GyroNan, span: Span { start_s: 2.0, length_s: 1.5 } };
        assert_eq!([1.99, 2.0, 3.49, 3.5].map(|t| fault.active(t)), [false, true, true, false]);
    }
}
