//! One good bag and each damage that bags of robots have had: what is read, or what is said.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use ruzstd::encoding::{CompressionLevel, compress_to_vec};
use whorl_bag::{BagOptions, BagWriter, Sample};
use whorl_msgs::Message;
use whorl_msgs::sensor_msgs::Imu;
use whorl_msgs::std_msgs::Header;
use whorl_node::Timestamp;

use crate::{ReadOptions, Recording, Series, read_run_with};

const EPOCH: i64 = 1_700_000_000_000_000_000;
const MS: i64 = 1_000_000;
const COUNT: u32 = 200;

/// A message before it is encoded, and as it is stored.
struct Written {
    stamp_ns: i64,
    imu: Imu,
    stored: fn(Vec<u8>) -> Vec<u8>,
}

/// The message of a sample: 100 Hz, swinging slowly.
fn good(i: u32) -> Written {
    let x = f64::from(i) * 0.01;
    let imu = Imu {
        angular_velocity: [x.sin(), 0.2 * (2.0 * x).cos(), 0.1 + 0.05 * (3.0 * x).sin()].into(),
        linear_acceleration: [0.3 * x.cos(), 0.1 * x.sin(), 9.8 + 0.05 * (5.0 * x).sin()].into(),
        ..Imu::default()
    };
    Written { stamp_ns: EPOCH + i64::from(i) * 10 * MS, imu, stored: |cdr| cdr }
}

fn bag(folder: &Path, message: impl Fn(u32) -> Written) -> PathBuf {
    let path = folder.join("bag");
    let mut writer = BagWriter::create(&path, BagOptions::default()).unwrap();
    let topic = writer.add_topic("/imu", "sensor_msgs/msg/Imu", "").unwrap();
    for i in 0..COUNT {
        let Written { stamp_ns, imu, stored } = message(i);
        let header = Header { stamp: Timestamp(stamp_ns).into(), frame_id: "imu".into() };
        let mut cdr = Vec::new();
        Message::from(Imu { header, ..imu }).encode_into(&mut cdr).unwrap();
        let log_time = Timestamp(EPOCH + i64::from(i) * 10 * MS + MS);
        let cdr = stored(cdr);
        let sample = Sample { log_time, publish_time: log_time, sequence: u64::from(i), cdr: &cdr };
        writer.write(topic, sample).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn read(bag: &Path) -> Result<Recording, String> {
    let map = bag.parent().unwrap().join("map.yaml");
    std::fs::write(&map, "bag:\n  ros__parameters:\n    platform: rig\n    imu: {topic: /imu}\n").unwrap();
    let options = ReadOptions { channels: Some(&map), ..ReadOptions::default() };
    let read = read_run_with(bag, &options).map_err(|error| error.to_string())?;
    Ok(read.into_iter().next().unwrap())
}

fn packed(cdr: Vec<u8>) -> Vec<u8> {
    compress_to_vec(cdr.as_slice(), CompressionLevel::Fastest)
}

fn not_measured(mut imu: Imu) -> Imu {
    imu.angular_velocity_covariance[0] = -1.0;
    imu.linear_acceleration_covariance[0] = -1.0;
    imu
}

/// One reads m/s^2, the other g.
fn second_sensor(mut written: Written) -> Written {
    let force = &mut written.imu.linear_acceleration;
    (force.x, force.y, force.z) = (force.x / 9.81, force.y / 9.81, force.z / 9.81);
    written
}

/// The same readings, as far apart in time: a run begins with its first message or its first stamp.
fn is_same(a: &Series<Vector3<f64>>, b: &Series<Vector3<f64>>) -> bool {
    let since = |series: &Series<Vector3<f64>>, k: usize| series.time_s[k] - series.time_s[0];
    a.value == b.value && (0..a.len()).all(|k| (since(a, k) - since(b, k)).abs() < 1e-9)
}

#[test]
fn every_damage_is_bridged_with_a_word_or_refused_for_its_reason() {
    type Damage<'a> = (&'a str, &'a dyn Fn(u32) -> Written, Result<&'a str, &'a str>);
    let cases: [Damage<'_>; 8] = [
        ("none", &good, Ok("")),
        ("messages compressed", &|i| Written { stored: packed, ..good(i) }, Ok("")),
        (
            "covariances of -1",
            &|i| Written { imu: not_measured(good(i).imu), ..good(i) },
            Ok(
                "200 messages of /imu say by angular_velocity_covariance[0] = -1 that the gyro was not measured \
                (sensor_msgs/Imu), and yet its numbers move: they were used.",
            ),
        ),
        (
            "covariances of -1 and no sensor",
            &|i| Written { imu: not_measured(Imu::default()), ..good(i) },
            Err(
                "linear_acceleration_covariance[0] = -1 that the accelerometer was not measured (sensor_msgs/Imu), and its \
                 numbers never move",
            ),
        ),
        (
            "two publishers, half a step apart",
            &|i| if i % 2 == 0 { good(i) } else { second_sensor(good(i)) },
            Err("two sensors send it"),
        ),
        (
            "two publishers, equal stamps",
            &|i| match (i % 2, good(i - i % 2)) {
                (0, written) => written,
                (_, written) => second_sensor(written),
            },
            Err("two sensors send it"),
        ),
        (
            "two publishers, equal stamps, now this one first and now that",
            &|i| match ((i / 2 * 7 / 3 + i) % 2, good(i - i % 2)) {
                (0, written) => written,
                (_, written) => second_sensor(written),
            },
            Err("two sensors send it"),
        ),
        (
            "bursts of four of one stamp",
            &|i| Written { stamp_ns: EPOCH + i64::from(i / 4) * 40 * MS + 30 * MS, ..good(i) },
            Ok("150 of them were spread evenly over the time since the stamp before"),
        ),
    ];
    let folder = tempfile::tempdir().unwrap();
    let right = read(&bag(folder.path(), good)).unwrap();
    for (name, message, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        match (read(&bag(folder.path(), message)), expected) {
            (Ok(found), Ok(words)) => {
                let said = found.remarks.join("\n");
                assert!(said.contains(words) && (!words.is_empty() || said.is_empty()), "{name}: {said}");
                assert!(is_same(&found.gyro_b_rad_s, &right.gyro_b_rad_s), "{name}");
                assert!(is_same(&found.specific_force_b_m_s2, &right.specific_force_b_m_s2), "{name}");
            }
            (Err(said), Err(words)) => assert!(said.contains(words), "{name}: {said}"),
            (Ok(found), Err(words)) => {
                panic!("{name}: read, and not refused with {words}: {:?}", found.remarks)
            }
            (Err(said), Ok(_)) => panic!("{name}: refused: {said}"),
        }
    }
}

/// As with any part of a bag that is damaged, what is before it is read.
#[test]
fn a_compressed_message_that_was_cut_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fn cut(cdr: Vec<u8>) -> Vec<u8> {
        packed(cdr).into_iter().take(40).collect()
    }
    let found =
        read(&bag(folder.path(), |i| if i < 150 { good(i) } else { Written { stored: cut, ..good(i) } }));
    let found = found.unwrap();
    assert_eq!(found.gyro_b_rad_s.len(), 150);
    assert!(found.remarks.iter().any(|r| r.contains("a message in zstd")), "{:?}", found.remarks);
}

#[test]
fn one_message_recorded_twice_is_one() {
    let folder = tempfile::tempdir().unwrap();
    let found = read(&bag(folder.path(), |i| good(i - i % 2))).unwrap();
    assert_eq!(found.gyro_b_rad_s.len(), 100);
    assert!(found.remarks.iter().any(|r| r.contains("100 messages of the gyro have the stamp of another")));
}

/// As `ros2 bag record --compression-mode file` leaves them, and by themselves.
#[test]
fn files_in_zstandard_are_read_and_other_forms_named_with_the_command_that_converts() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag(folder.path(), good);
    let right = read(&path).unwrap();
    let whole = std::fs::read(path.join("bag_0.mcap")).unwrap();
    let compressed = path.join("bag_0.mcap.zstd");
    std::fs::write(&compressed, packed(whole.clone())).unwrap();
    std::fs::remove_file(path.join("bag_0.mcap")).unwrap();
    let metadata = path.join("metadata.yaml");
    let good_text = std::fs::read_to_string(&metadata).unwrap();
    let said_to_be = |format: &str| {
        let text = good_text.replace("compression_mode: \"\"", "compression_mode: FILE");
        let text = text.replace("compression_format: \"\"", &format!("compression_format: {format}"));
        assert_ne!(text, good_text);
        std::fs::write(&metadata, text).unwrap();
    };
    said_to_be("zstd");
    for bag in [&path, &compressed] {
        assert_eq!(read(bag).unwrap().gyro_b_rad_s, right.gyro_b_rad_s, "{}", bag.display());
    }
    std::fs::write(&compressed, &packed(whole.clone())[..whole.len() / 20]).unwrap();
    assert!(read(&path).unwrap_err().contains("zstd"), "a file that was cut");
    std::fs::rename(&compressed, path.join("bag_0.mcap.lz4")).unwrap();
    said_to_be("lz4");
    let said = read(&path).unwrap_err();
    assert!(said.contains("compression_format `lz4`") && said.contains("ros2 bag convert -i"), "{said}");
    std::fs::remove_file(&metadata).unwrap();
    std::fs::rename(path.join("bag_0.mcap.lz4"), path.join("bag_0.db3.zstd")).unwrap();
    for bag in [&path, &path.join("bag_0.db3.zstd")] {
        let said = read(bag).unwrap_err();
        assert!(said.contains("stored as sqlite3") && said.contains("rosbags-convert"), "{said}");
    }
}
