//! Writes a short run with messages on every topic, to be read by other programs:
//! `cargo run -p whorl_bag --example sample_run -- DIRECTORY [--killed | --recover]`.
//!
//! `--killed` ends the process in the middle of recording, without any clean-up. `--recover` makes the run
//! in DIRECTORY complete. Prints the run directory.

use std::path::Path;

use whorl_bag::{BagOptions, RunDescription, RunDirectory, RunWriter};
use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use whorl_msgs::geometry_msgs::{Quaternion, TransformStamped, Vector3};
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let directory = arguments.next().ok_or("usage: sample_run DIRECTORY [--killed | --recover]")?;
    let mode = arguments.next();
    if mode.as_deref() == Some("--recover") {
        println!("{:?}", RunDirectory::open(Path::new(&directory))?.recover()?);
        return Ok(());
    }
    let description = RunDescription {
        experiment: "sample".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        seed: Some(1),
        platforms: vec!["whorl_1".into(), "whorl_2".into()],
        ..RunDescription::default()
    };
    let start = Timestamp(1_790_000_000_000_000_000);
    let mut run = RunWriter::create(Path::new(&directory), description, start, BagOptions::default())?;
    run.add_parameters("effective.yaml", "this program", b"/**:\n  ros__parameters: {}\n")?;
    println!("{}", run.path().display());
    for tick in 0..1_000u64 {
        let now = Timestamp(start.0 + tick as i64 * 10_000_000);
        for &topic in Topic::ALL {
            let every = (100.0 / topic.info().rate_hz) as u64;
            if !tick.is_multiple_of(every) {
                continue;
            }
            let platforms = if topic.info().per_platform { vec![Some(0), Some(1)] } else { vec![None] };
            for platform in platforms {
                let route = Route { platform: platform.map(PlatformId), topic };
                run.write_message(route, now, &message(topic, tick / every, now))?;
            }
        }
        if mode.as_deref() == Some("--killed") && tick == 900 {
            std::process::abort();
        }
    }
    run.finish(Timestamp(start.0 + 10_000_000_000))?;
    Ok(())
}

/// A message whose lists are not empty and whose numbers include those that are hard to write down.
fn message(topic: Topic, sequence: u64, now: Timestamp) -> Message {
    let x = (sequence as f64 * 0.37).sin();
    let vector = Vector3 { x, y: f64::NAN, z: -0.0 };
    let mut message = Message::default_of(topic.info().message_type);
    match &mut message {
        Message::Imu(m) => {
            m.header.stamp = now.into();
            m.header.frame_id = "whorl_1/base_link".into();
            m.angular_velocity = vector;
            m.orientation_covariance[0] = -1.0;
        }
        Message::Vector3Stamped(m) => m.vector = vector,
        Message::JointState(m) => {
            m.name = vec!["wheel_x".into(), "wheel_y".into(), "wheel_z".into()];
            m.velocity = vec![x, f64::INFINITY, 1e-310];
            m.effort = vec![x; sequence as usize % 4];
        }
        Message::ThrusterState(m) => {
            m.sequence = sequence;
            m.valve_open = vec![sequence.is_multiple_of(2), true, false];
            m.on_time_s = vec![x; 3];
            m.health = vec![0, 1, 255];
        }
        Message::BatteryState(m) => {
            m.voltage = x as f32;
            m.present = true;
            m.cell_voltage = vec![3.7, f32::NAN];
            m.location = "b\u{e4}y".into();
        }
        Message::FluidPressure(m) => m.fluid_pressure = x,
        Message::Temperature(m) => m.temperature = x,
        Message::ActuatorCommand(m) => {
            m.sequence = sequence;
            m.valid_until = now.into();
            m.wheel_torque_n_m = vec![x; 3];
            m.jet_slot = u64::MAX;
            m.jet_on_time_s = vec![x; 12];
        }
        Message::AttitudeEstimate(m) => {
            m.sequence = sequence;
            m.q_world_body = Quaternion { x: 0.5, y: -0.5, z: 0.5, w: 0.5 };
            m.omega_wb_b_rad_s = vector;
            m.covariance[35] = x;
            m.nis_dof = 3;
            m.rejected_samples = 7;
        }
        Message::AttitudeReference(m) => {
            m.sequence = sequence;
            m.omega_dot_wr_r_rad_s2 = vector;
        }
        Message::ControlStatus(m) => {
            m.sequence = sequence;
            m.jet_saturated = vec![true; 5];
            m.jet_failed = vec![false; sequence as usize % 3];
            m.alpha = x;
        }
        Message::FormationCommand(m) => m.sequence = sequence,
        Message::Excitation(m) => m.sequence = sequence,
        Message::ClockRequest(m) => m.sequence = sequence,
        Message::ClockReply(m) => m.sequence = sequence,
        Message::ParameterEstimate(m) => m.sequence = sequence,
        Message::FormationState(m) => {
            m.sequence = sequence;
            m.experiment = "sample".into();
            m.platforms = vec!["whorl_1".into(), "whorl_2".into()];
            m.relative_error_rad = vec![vector; 2];
            m.link_age_s = vec![f64::INFINITY, x];
            m.link_ok = vec![false, true];
        }
        Message::DiagnosticArray(m) => fill(m, now),
        Message::TFMessage(m) => {
            let mut transform =
                TransformStamped { child_frame_id: "whorl_1/base_link".into(), ..Default::default() };
            transform.header.frame_id = "world".into();
            transform.transform.translation = vector;
            m.transforms = vec![transform; 2];
        }
        // Types that are parts of others.
        _ => {}
    }
    message
}

fn fill(array: &mut DiagnosticArray, now: Timestamp) {
    array.header.stamp = now.into();
    let values = vec![KeyValue { key: "a, \"b\"".into(), value: String::new() }];
    array.status = vec![DiagnosticStatus { level: 2, name: "driver".into(), values, ..Default::default() }];
}
