//! Bags as robots leave them.

use std::path::{Path, PathBuf};

use nalgebra::{UnitQuaternion, Vector3};
use whorl_bag::{BagOptions, BagWriter, Sample};
use whorl_msgs::Message;
use whorl_msgs::geometry_msgs::{PoseStamped, TransformStamped, Vector3Stamped};
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_node::Timestamp;

use crate::{ReadOptions, Recording, RecordingError, read_run_with};

const EPOCH: i64 = 1_700_000_000_000_000_000;
const MS: i64 = 1_000_000;

/// What is written at 100 Hz for 2 s: topic, its type, and the message of a sample with a stamp.
type Topic<'a> = (&'a str, &'a str, &'a dyn Fn(u32, Header) -> Option<Message>);

/// Writes a bag; `stamp` is that of a sample at its true time.
fn bag(folder: &Path, topics: &[Topic<'_>], stamp: &dyn Fn(u32, i64) -> i64) -> PathBuf {
    let path = folder.join("bag");
    let mut writer = BagWriter::create(&path, BagOptions::default()).unwrap();
    let handles: Vec<_> =
        topics.iter().map(|(name, kind, _)| writer.add_topic(name, kind, "").unwrap()).collect();
    let mut cdr = Vec::new();
    for i in 0..200u32 {
        let at = EPOCH + i64::from(i) * 10 * MS;
        for ((_, _, message), handle) in topics.iter().zip(&handles) {
            let header = Header { stamp: Timestamp(stamp(i, at)).into(), frame_id: "imu".into() };
            let Some(message) = message(i, header) else { continue };
            message.encode_into(&mut cdr).unwrap();
            let log_time = Timestamp(at + MS);
            let sample = Sample { log_time, publish_time: log_time, sequence: u64::from(i), cdr: &cdr };
            writer.write(*handle, sample).unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

fn imu(i: u32, header: Header) -> Message {
    let x = f64::from(i);
    Imu {
        header,
        angular_velocity: [x, 0.0, 0.1].into(),
        linear_acceleration: [0.0, 0.01 * x, 9.8].into(),
        ..Imu::default()
    }
    .into()
}

const IMU: Topic<'static> = ("/imu/data", "sensor_msgs/msg/Imu", &|i, header| Some(imu(i, header)));

fn read(bag: &Path, map: &str) -> Result<Recording, RecordingError> {
    let file = bag.parent().unwrap().join("map.yaml");
    std::fs::write(&file, format!("bag:\n  ros__parameters:\n    platform: rig\n{map}")).unwrap();
    let options = ReadOptions { channels: Some(&file), ..ReadOptions::default() };
    Ok(read_run_with(bag, &options)?.remove(0))
}

fn said(recording: &Recording, words: &str) -> bool {
    recording.remarks.iter().any(|remark| remark.contains(words))
}

const ONE: &str = "    imu: {topic: /imu/data}\n";

#[test]
fn stamps_of_zero_and_a_clock_that_was_set_back_do_not_spoil_the_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), &[IMU], &|i, at| if i % 50 == 30 { 0 } else { at });
    let recording = read(&path, ONE).unwrap();
    assert_eq!(recording.gyro_b_rad_s.len(), 200);
    assert!((recording.duration_s() - 1.99).abs() < 1e-9, "{}", recording.duration_s());
    assert!(said(&recording, "4 of 200 messages of /imu/data have no stamp"), "{:?}", recording.remarks);
    std::fs::remove_dir_all(&path).unwrap();
    let path = bag(folder.path(), &[IMU], &|i, at| if i < 100 { at } else { at - 192 * MS });
    let recording = read(&path, ONE).unwrap();
    let times = &recording.gyro_b_rad_s.time_s;
    assert!(times.iter().enumerate().all(|(i, t)| (t - i as f64 * 0.01).abs() < 1e-9));
    assert!(recording.gyro_b_rad_s.value.iter().enumerate().all(|(i, v)| v.x == i as f64));
    assert!(
        said(&recording, "clock of /imu/data was set back by 0.192 s at 1.000 s"),
        "{:?}",
        recording.remarks
    );
}

#[test]
fn halves_on_two_topics_are_one_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let none = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let gyro = |i: u32, header: Header| {
        let Message::Imu(m) = imu(i, header) else { return None };
        Some(Imu { linear_acceleration_covariance: none, ..m }.into())
    };
    // Half the rate, between the gyro's samples.
    let force = |i: u32, header: Header| {
        let Message::Imu(m) = imu(i, header) else { return None };
        i.is_multiple_of(2).then(|| Imu { angular_velocity_covariance: none, ..m }.into())
    };
    let kind = "sensor_msgs/msg/Imu";
    let path = bag(folder.path(), &[("/gyro", kind, &gyro), ("/accel", kind, &force)], &|_, at| at);
    let map = "    gyro: {topic: /gyro}\n    accelerometer: {topic: /accel}\n";
    let recording = read(&path, map).unwrap();
    assert_eq!((recording.gyro_b_rad_s.len(), recording.specific_force_b_m_s2.len()), (200, 100));
    assert_eq!(recording.specific_force_b_m_s2.value[3].y, 0.06);
    let both = read(&path, &format!("{map}    imu: {{topic: /gyro}}\n")).unwrap_err().to_string();
    assert!(both.contains("imu alone, or gyro and accelerometer"), "{both}");
}

#[test]
fn two_sensors_on_one_topic_are_refused_until_the_map_says_which() {
    let folder = tempfile::tempdir().unwrap();
    let two = |i: u32, header: Header| {
        let frame_id = if i.is_multiple_of(2) { "left" } else { "right" };
        Some(imu(i, Header { frame_id: frame_id.into(), ..header }))
    };
    let path = bag(folder.path(), &[("/imu/data", "sensor_msgs/msg/Imu", &two)], &|_, at| at);
    let refused = read(&path, ONE).unwrap_err().to_string();
    assert!(refused.contains("left 100 times, right 100 times") && refused.contains("frame_id"), "{refused}");
    let recording = read(&path, "    imu: {topic: /imu/data, frame_id: right}\n").unwrap();
    assert_eq!((recording.gyro_b_rad_s.len(), recording.gyro_b_rad_s.value[0].x), (100, 1.0));
    assert!(said(&recording, "100 messages of other frames"));
}

#[test]
fn a_topic_without_a_stored_type_is_read_as_what_the_map_implies() {
    let folder = tempfile::tempdir().unwrap();
    let mag = |i: u32, header: Header| {
        Some(Vector3Stamped { header, vector: [0.0, 3.0, f64::from(i)].into() }.into())
    };
    let path = bag(folder.path(), &[("/imu/data", "", IMU.2), ("/mag", "", &mag)], &|_, at| at);
    let map = format!("{ONE}    vector: {{topic: /mag, reference_world: [0, 1, 0]}}\n");
    let recording = read(&path, &map).unwrap();
    assert_eq!((recording.gyro_b_rad_s.len(), recording.vectors[0].direction_b.len()), (200, 200));
    assert!(said(&recording, "no type for /imu/data: its messages were read as sensor_msgs/msg/Imu"));
    let wrong = read(&path, "    imu: {topic: /mag}\n").unwrap_err().to_string();
    assert!(wrong.contains("no type for /mag, and its 200 messages are not sensor_msgs/msg/Imu"), "{wrong}");
}

#[test]
fn attitudes_of_other_systems_are_truth_or_directions() {
    let folder = tempfile::tempdir().unwrap();
    let q = |i: u32| UnitQuaternion::from_euler_angles(0.1, -0.2, 0.02 * f64::from(i));
    let ros =
        |q: UnitQuaternion<f64>| whorl_msgs::geometry_msgs::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w };
    let pose = |i: u32, header: Header| {
        let mut m = PoseStamped { header, ..PoseStamped::default() };
        m.pose.orientation = ros(q(i));
        // Motion capture lost it: zeros.
        if i == 7 {
            m.pose.orientation = whorl_msgs::geometry_msgs::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
        }
        Some(m.into())
    };
    let transform = |i: u32, header: Header| {
        let mut m =
            TransformStamped { header, child_frame_id: "table".into(), ..TransformStamped::default() };
        m.transform.rotation = ros(q(i));
        Some(m.into())
    };
    // An Odometry begins as a TransformStamped does.
    let topics: [Topic<'_>; 4] = [
        IMU,
        ("/pose", "geometry_msgs/msg/PoseStamped", &pose),
        ("/transform", "geometry_msgs/msg/TransformStamped", &transform),
        ("/odometry", "nav_msgs/msg/Odometry", &transform),
    ];
    let path = bag(folder.path(), &topics, &|_, at| at);
    for (topic, count) in [("/pose", 199), ("/transform", 200), ("/odometry", 200)] {
        let recording = read(&path, &format!("{ONE}    pose: {{topic: {topic}}}\n")).unwrap();
        let truth = &recording.truth.as_ref().unwrap().q_world_body;
        assert_eq!(truth.len(), count, "{topic}");
        assert!(truth.value[3].angle_to(&q(3)) < 1e-9, "{topic}");
    }
    let recording = read(&path, &format!("{ONE}    pose: {{topic: /pose, use: directions}}\n")).unwrap();
    assert_eq!((recording.vectors.len(), recording.truth.is_none()), (2, true));
    let up = recording.vectors[1].direction_b.value[3];
    assert!((up - q(3).inverse_transform_vector(&Vector3::z())).norm() < 1e-9);
    assert_eq!(*recording.vectors[0].reference_world, Vector3::x());
    let wrong = read(&path, &format!("{ONE}    pose: {{topic: /imu/data}}\n")).unwrap_err().to_string();
    assert!(
        wrong
            .contains("allowed: geometry_msgs/msg/PoseStamped, geometry_msgs/msg/TransformStamped, nav_msgs"),
        "{wrong}"
    );
}

#[test]
fn metadata_that_are_wrong_about_the_file_are_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), &[IMU], &|_, at| at);
    let metadata = path.join("metadata.yaml");
    let good = std::fs::read_to_string(&metadata).unwrap();
    let cases = [
        (good.replace("storage_identifier: mcap", "storage_identifier: \"\""), "it names no storage"),
        (good.replace("storage_identifier: mcap", "storage_identifier: sqlite3"), "the storage is sqlite3"),
        (String::new(), "metadata.yaml is not right"),
        ("a: [".to_owned(), "metadata.yaml is not right"),
        (good.replace("bag_0.mcap", "other.mcap"), "other.mcap is not there"),
    ];
    for (text, words) in cases {
        assert_ne!(text, good);
        std::fs::write(&metadata, &text).unwrap();
        let recording = read(&path, ONE).unwrap();
        assert_eq!(recording.gyro_b_rad_s.len(), 200, "{words}");
        assert!(said(&recording, words), "{words}: {:?}", recording.remarks);
    }
    std::fs::remove_file(&metadata).unwrap();
    assert_eq!(read(&path, ONE).unwrap().gyro_b_rad_s.len(), 200);
}

#[test]
fn a_bag_that_was_cut_in_its_first_part_is_called_incomplete() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), &[IMU], &|_, at| at);
    let file = std::fs::read_dir(&path)
        .unwrap()
        .map(|f| f.unwrap().path())
        .find(|f| f.extension().is_some_and(|e| e == "mcap"));
    let file = std::fs::File::options().write(true).open(file.unwrap()).unwrap();
    file.set_len(2_000).unwrap();
    let said = read(&path, ONE).unwrap_err().to_string();
    assert!(
        said.contains("it is incomplete") && said.contains("killed before its first part was whole"),
        "{said}"
    );
    assert!(!said.contains("has: ;"), "{said}");
}

/// Every error with every text empty: a sentence has no hole.
#[test]
fn no_error_has_an_empty_blank_in_it() {
    let path = || PathBuf::from("run");
    let text = String::new;
    let all = [
        RecordingError::NoMeasurements { path: path(), present: text() },
        RecordingError::NoSuchJoint { path: path(), joint: "a".into(), present: text() },
        RecordingError::NoSuchPlatform { path: path(), platform: "a".into(), present: text() },
        RecordingError::NothingFinite {
            path: path(),
            platform: "a".into(),
            messages: 0,
            said: String::new(),
        },
        RecordingError::NothingInCsv { path: path(), rows: 0 },
        RecordingError::TooLong { path: path(), length_s: 0.0 },
        RecordingError::NoReferenceWorld { path: path(), sensor: 1 },
        RecordingError::SeveralModels { path: path(), present: Vec::new() },
    ];
    for error in all {
        let said = error.to_string();
        for hole in [": ;", ": ,", " ,", " ;", " :", "  ", "``", "( ", "()", "has .", "is ."] {
            assert!(!said.contains(hole), "{hole:?} in {said}");
        }
        assert!(!said.trim_end().ends_with(':'), "{said}");
    }
}
