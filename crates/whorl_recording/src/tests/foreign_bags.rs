//! Bags of other systems, with a topic map.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use whorl_bag::{BagOptions, BagWriter, Sample};
use whorl_msgs::Message;
use whorl_msgs::geometry_msgs::Vector3Stamped;
use whorl_msgs::sensor_msgs::{Imu, JointState};
use whorl_msgs::std_msgs::Header;
use whorl_node::Timestamp;

use super::whorl_1;
use crate::{ReadOptions, RecordingError, read_run, read_run_with};

const MAP: &str = "bag:
  ros__parameters:
    platform: table
    imu: {topic: /xsens/imu}
    vector: {topic: /xsens/mag, reference_world: [0, 1, 0]}
    wheel_state: {topic: /joint_states, joints: [wz, wx]}
    closed_loop: true
";

/// 1 s of a bag as ros2 bag records it: times since 1970, an arm's joint among the wheels.
fn bag(folder: &Path) -> PathBuf {
    let path = folder.join("bag");
    let mut writer = BagWriter::create(&path, BagOptions::default()).unwrap();
    let imu = writer.add_topic("/xsens/imu", "sensor_msgs/msg/Imu", "").unwrap();
    let mag = writer.add_topic("/xsens/mag", "sensor_msgs/msg/MagneticField", "").unwrap();
    let joints = writer.add_topic("/joint_states", "sensor_msgs/msg/JointState", "").unwrap();
    let command = writer.add_topic("/rw/command", "sensor_msgs/msg/JointState", "").unwrap();
    let mut cdr = Vec::new();
    for i in 0..100u32 {
        let stamp = Timestamp(1_700_000_000_000_000_000 + i64::from(i) * 10_000_000);
        let header = || Header { stamp: stamp.into(), frame_id: "imu".into() };
        let x = f64::from(i);
        let force = [0.01 * x, 0.02 * x, 9.8 + 1e-4 * x];
        let motion = Imu {
            header: header(),
            angular_velocity: [x, -x, 1e-3 * x].into(),
            linear_acceleration: force.into(),
            ..Imu::default()
        };
        let field = Vector3Stamped { header: header(), vector: [0.0, 3e-5, 4e-5].into() };
        let names = ["wx", "arm", "wz"].map(str::to_owned).to_vec();
        let state = JointState {
            header: header(),
            name: names,
            position: Vec::new(),
            velocity: vec![1.0 + x, 55.0, 3.0],
            effort: vec![0.1; 3],
        };
        let effort = vec![0.01, 0.02];
        let told = JointState {
            header: header(),
            name: vec!["rx".into(), "rz".into()],
            effort,
            ..JointState::default()
        };
        for (topic, message) in [
            (imu, Message::from(motion)),
            (mag, field.into()),
            (joints, state.into()),
            (command, told.into()),
        ] {
            message.encode_into(&mut cdr).unwrap();
            if topic == mag {
                // The covariance that a MagneticField has behind its field.
                cdr.extend([0; 72]);
            }
            let log_time = Timestamp(stamp.0 + 1_000_000);
            let sample = Sample { log_time, publish_time: log_time, sequence: u64::from(i), cdr: &cdr };
            writer.write(topic, sample).unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

#[test]
fn standard_messages_are_read_by_the_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path());
    // Without a map it says what would help.
    let text = read_run(&path, None).unwrap_err().to_string();
    assert!(text.contains("/xsens/imu") && text.contains("channels.yaml"), "{text}");
    std::fs::write(path.join("channels.yaml"), MAP).unwrap();
    let recordings = read_run(&path, None).unwrap();
    let r = &recordings[0];
    assert_eq!((recordings.len(), r.platform.as_str(), r.closed_loop), (1, "table", true));
    assert_eq!((r.gyro_b_rad_s.len(), r.gyro_b_rad_s.time_s[1]), (100, 0.01));
    assert_eq!(r.gyro_b_rad_s.value[2], Vector3::new(2.0, -2.0, 2e-3));
    assert_eq!(r.wheel_speed_rad_s.value[5], [3.0, 6.0]);
    assert!(r.wheel_torque_command_n_m.is_empty(), "efforts are measured");
    assert!((r.vectors[0].direction_b.value[0] - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-12);
    assert_eq!(*r.vectors[0].reference_world, Vector3::y());
    // Commands with joints of their own names.
    let commanded = format!("{MAP}    wheel_torque_command: {{topic: /rw/command, joints: [rz, rx]}}\n");
    std::fs::write(path.join("channels.yaml"), commanded).unwrap();
    assert_eq!(read_run(&path, None).unwrap()[0].wheel_torque_command_n_m.value[0], [0.02, 0.01]);
    // Two channels of one topic: its efforts are commands as well.
    let shared = format!("{MAP}    wheel_torque_command: {{topic: /joint_states}}\n");
    std::fs::write(path.join("channels.yaml"), shared).unwrap();
    let recording = &read_run(&path, None).unwrap()[0];
    assert_eq!(recording.wheel_torque_command_n_m.value[0], [0.1, 0.1]);
    assert_eq!(recording.wheel_speed_rad_s.value[5], [3.0, 6.0]);
    // Two wheels are not Whorl-I's three.
    let known = whorl_1();
    let options = ReadOptions { model: Some(&known.model), ..ReadOptions::default() };
    assert!(matches!(read_run_with(&path, &options), Err(RecordingError::OtherPlatform { .. })));
}

#[test]
fn maps_that_do_not_fit_are_refused_with_line_and_hint() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path());
    let map = folder.path().join("map.yaml");
    let error = |text: &str| {
        std::fs::write(&map, text).unwrap();
        let options = ReadOptions { channels: Some(&map), ..ReadOptions::default() };
        let text = read_run_with(&path, &options).unwrap_err().to_string();
        text.replace(&format!("{}/", folder.path().display()), "")
    };
    assert_eq!(
        error(&MAP.replace("/xsens/imu", "/imu")),
        "map.yaml:4: imu.topic = /imu: the bag has no such topic; it has: /xsens/imu, /xsens/mag, /joint_states, /rw/command"
    );
    assert_eq!(
        error(&MAP.replace("/xsens/imu", "/joint_states")),
        "map.yaml:4: imu.topic = /joint_states: its messages are sensor_msgs/msg/JointState; allowed: sensor_msgs/msg/Imu"
    );
    assert_eq!(
        error(&MAP.replace("[wz, wx]", "[wz, wy]")),
        "bag: no joint is called wy, as the topic map says; there are: wx, arm, wz"
    );
    let text = error(&MAP.replace("joints:", "joint:"));
    assert!(text.contains("did you mean wheel_state.joints?"), "{text}");
    let text = error("bag:\n  ros__parameters:\n    platform: table\n");
    assert!(text.contains("there are no measurements of a platform"), "{text}");
}
