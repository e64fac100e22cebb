//! Messages as no sender should send them.

use whorl_msgs::sensor_msgs::{Imu, JointState};
use whorl_msgs::std_msgs::Header;
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate, ThrusterState};
use whorl_msgs::{Message, Topic};
use whorl_node::Timestamp;

/// Of (kind, numbers, stamp in 10 ms, counter).
pub(super) fn message((kind, numbers, stamp, counter): &(usize, Vec<f64>, i64, u64)) -> (Topic, Message) {
    let header = Header { stamp: Timestamp(stamp * 10_000_000 + 30_000_000).into(), frame_id: String::new() };
    let odd = |x: &f64| if x.abs() < 1e299 { *x * 1e-300 } else { f64::NAN };
    let numbers: Vec<f64> = numbers.iter().map(odd).collect();
    let first = numbers.first().copied().unwrap_or(f64::INFINITY);
    match kind {
        0 => {
            let linear_acceleration = [first, 0.0, 9.8].into();
            (Topic::ImuRaw, Imu { header, linear_acceleration, ..Imu::default() }.into())
        }
        1 | 2 => {
            let effort = numbers.iter().rev().copied().collect();
            let state = JointState { header, velocity: numbers, effort, ..JointState::default() };
            (Topic::WheelState, state.into())
        }
        3 | 4 => {
            let state = ThrusterState {
                header,
                sequence: *counter,
                valve_open: numbers.iter().map(|x| *x > 0.0).collect(),
                on_time_s: numbers.clone(),
                total_on_time_s: numbers,
                health: Vec::new(),
            };
            (Topic::ThrusterState, state.into())
        }
        5 => {
            let command = ActuatorCommand {
                header,
                sequence: *counter,
                valid_until: Timestamp((stamp + 5) * 10_000_000).into(),
                wheel_torque_n_m: numbers.clone(),
                jet_slot: counter / 2,
                jet_slot_length_s: first.abs(),
                jet_on_time_s: numbers,
                gimbal_rate_rad_s: Vec::new(),
            };
            (Topic::ActuatorCommand, command.into())
        }
        _ => {
            (Topic::TruthState, AttitudeEstimate { header, nis: first, ..AttitudeEstimate::default() }.into())
        }
    }
}
