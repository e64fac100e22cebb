//! Runs that cannot be used, and what is said of them.

use std::path::Path;

use nalgebra::Vector3;
use whorl_bag::{BagOptions, RunDescription, RunWriter};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;

use super::{parameters, whorl_1};
use crate::{Recording, RecordingError, RunOrigin, Series, read_model, read_run, write_run};

fn run_with(messages: &[(Topic, Message)], folder: &Path) -> std::path::PathBuf {
    let description = RunDescription { platforms: vec!["a".into()], ..RunDescription::default() };
    let path = folder.join("run");
    let mut writer = RunWriter::create_in(&path, description, Timestamp(0), BagOptions::default()).unwrap();
    for (i, (topic, message)) in messages.iter().enumerate() {
        let route = Route::platform(PlatformId(0), *topic);
        writer.write_message(route, Timestamp(i as i64 * 10_000_000), message).unwrap();
    }
    writer.finish(Timestamp(0)).unwrap();
    path
}

fn imu(rate: f64) -> Message {
    Imu { angular_velocity: [rate; 3].into(), linear_acceleration: [rate; 3].into(), ..Imu::default() }.into()
}

#[test]
fn a_bag_without_the_needed_topics_says_which_are_needed() {
    let folder = tempfile::tempdir().unwrap();
    let path = run_with(
        &[(Topic::Battery, Message::default_of(whorl_msgs::MessageType::BatteryState))],
        folder.path(),
    );
    let text = read_run(&path, None).unwrap_err().to_string();
    assert!(text.contains("imu/data_raw") && text.contains("it has /a/battery"), "{text}");
    let nothing = tempfile::tempdir().unwrap();
    let text = read_run(&run_with(&[], nothing.path()), None).unwrap_err().to_string();
    assert!(text.contains("it has no topics"), "{text}");
    let text = read_run(&nothing.path().join("none"), None).unwrap_err().to_string();
    assert!(text.ends_with("none does not exist"), "{text}");
}

#[test]
fn nan_everywhere_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let messages = vec![(Topic::ImuRaw, imu(f64::NAN)); 7];
    let text = read_run(&run_with(&messages, folder.path()), None).unwrap_err().to_string();
    assert!(text.contains("a has 7 messages") && text.contains("not one finite number"), "{text}");
}

#[test]
fn a_frozen_sensor_and_a_short_run_are_remarked() {
    let folder = tempfile::tempdir().unwrap();
    let mut messages = Vec::new();
    for i in 0..40 {
        let mut message = Imu {
            angular_velocity: [0.1, 0.2, f64::from(i)].into(),
            linear_acceleration: [f64::from(i) * 1e-3, f64::from(i) * 1e-3, 9.8 + f64::from(i) * 1e-3].into(),
            ..Imu::default()
        };
        message.header.stamp = Timestamp(i64::from(i) * 10_000_000).into();
        messages.push((Topic::ImuRaw, message.into()));
    }
    let recording = &read_run(&run_with(&messages, folder.path()), None).unwrap()[0];
    assert_eq!(recording.gyro_b_rad_s.len(), 40);
    let remarks = recording.remarks.join("\n");
    assert!(
        remarks.contains("40 readings in 0.4 s: too few") && remarks.contains("all 40 samples (x, y)"),
        "{remarks}"
    );
    assert!(!recording.closed_loop);
}

#[test]
fn the_model_of_another_platform_is_refused() {
    let known = whorl_1();
    let recording = Recording {
        name: "r".into(),
        wheel_speed_rad_s: Series { time_s: vec![0.0], value: vec![vec![1.0; 4]] },
        ..Recording::default()
    };
    assert_eq!(
        recording.check_fits(&known.model, "whorl_1").unwrap_err().to_string(),
        "the run r is of a platform with 4 wheels, and the model whorl_1 has 3: is it the model of another platform?"
    );
    assert!(Recording::default().check_fits(&known.model, "whorl_1").is_ok());
}

#[test]
fn models_that_are_not_there_are_missed_with_a_hint() {
    let error = |source: &Path, platform| read_model(source, platform).unwrap_err().to_string();
    let text = error(&parameters().join("whorl_1.yaml"), Some("whorl_9"));
    assert!(text.contains("it has the model of whorl_1, not of whorl_9"), "{text}");
    let text = error(&parameters().join("common.yaml"), None);
    assert!(text.contains("there is no platform model in it"), "{text}");
    let folder = tempfile::tempdir().unwrap();
    let text = error(&run_with(&[], folder.path()), None);
    assert!(text.contains("holds no parameters: name the platform's file"), "{text}");
    let text = error(&folder.path().join("x.yaml"), None);
    assert!(text.contains("x.yaml: does not exist"), "{text}");
}

/// A file with a section for every platform names none: it is called after the file, also in the run that was
/// written with it.
#[test]
fn a_model_for_every_platform_is_found_again_in_its_run() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(super::parameters().join("whorl_1.yaml")).unwrap();
    let model = folder.path().join("table.yaml");
    std::fs::write(&model, text.replace("/whorl_1/**:", "/**:")).unwrap();
    let known = read_model(&model, None).unwrap();
    assert_eq!(known.platform, "table");
    let recording = Recording {
        platform: "table".into(),
        gyro_b_rad_s: Series { time_s: vec![0.0, 1.0], value: vec![Vector3::zeros(); 2] },
        ..Recording::default()
    };
    let run = write_run(&recording, &known, &RunOrigin::default(), &folder.path().join("run")).unwrap();
    assert_eq!(read_model(&run, None).unwrap().platform, "table");
    assert_eq!(read_run(&run, None).unwrap()[0].platform, "table");
}

#[test]
fn a_run_is_not_written_over_another() {
    let folder = tempfile::tempdir().unwrap();
    let recording = Recording {
        platform: "whorl_1".into(),
        gyro_b_rad_s: Series { time_s: vec![0.0], value: vec![Vector3::x()] },
        ..Recording::default()
    };
    let write = || write_run(&recording, &whorl_1(), &RunOrigin::default(), folder.path());
    write().unwrap();
    assert!(matches!(write(), Err(RecordingError::Bag(whorl_bag::BagError::Exists { .. }))));
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(64))]
    /// Messages of any content: a recording or an error, never a panic, and only finite values.
    #[test]
    fn any_messages_are_survived(
        rows in proptest::collection::vec(
            (0usize..7, proptest::collection::vec(-1e300..1e300f64, 0..4), -3i64..3, 0u64..4), 1..40),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let messages: Vec<(Topic, Message)> = rows.iter().map(super::bad_messages::message).collect();
        if let Ok(recordings) = read_run(&run_with(&messages, folder.path()), None) {
            for r in recordings {
                let finite = |x: f64| x.is_finite();
                proptest::prop_assert!(r.wheel_torque_command_n_m.value.iter().flatten().copied().all(finite));
                for pulses in &r.jet_pulses {
                    proptest::prop_assert!(pulses.iter().all(|p| p.off_s > p.on_s));
                    proptest::prop_assert!(pulses.windows(2).all(|w| w[0].off_s < w[1].on_s));
                }
                for time in [&r.wheel_torque_command_n_m.time_s, &r.gyro_b_rad_s.time_s] {
                    proptest::prop_assert!(time.windows(2).all(|w| w[0] < w[1]));
                }
            }
        }
    }
}
