//! What is written is read.

use proptest::prelude::*;
use whorl_msgs::{MessageType, Topic};
use whorl_node::Timestamp;

use super::{encoded, estimate, sample, time, unfinished};
use crate::{
    BagError, BagOptions, BagReader, BagWriter, Compression, MessageFilter, Sample, offered_qos_profiles,
};

fn types() -> Vec<(&'static str, &'static str)> {
    // One that has no definition: its schema is empty.
    let known = MessageType::ALL.iter().map(|t| t.name());
    known
        .chain(["unknown_msgs/msg/Anything"])
        .zip(["/a", "/b/c", "/whorl_1/imu/data_raw", "/d", "/e"])
        .map(|(t, n)| (n, t))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any bytes at any times on any topics come back equal, in the order of their log time, from bags of
    /// any chunk size, in one file or several, and also when the bag is written again from what was read.
    #[test]
    fn messages_come_back_equal_and_in_order(
        messages in proptest::collection::vec(
            (0usize..5, 0i64..5_000_000_000, 0i64..i64::MAX, any::<u32>(), proptest::collection::vec(any::<u8>(), 0..200)),
            0..300,
        ),
        max_chunk_bytes in 1usize..5_000,
        lz4 in any::<bool>(),
        max_file_ms in proptest::option::of(1u64..4_000),
    ) {
        let directory = tempfile::tempdir().unwrap();
        let options = BagOptions {
            max_file_age: max_file_ms.map(std::time::Duration::from_millis),
            compression: if lz4 { Compression::Lz4 } else { Compression::None },
            max_chunk_bytes,
            ..BagOptions::default()
        };
        let mut expected = messages.clone();
        expected.sort_by_key(|m| m.1);
        let mut given = messages;
        for name in ["first", "second"] {
            let path = directory.path().join(name);
            let mut writer = BagWriter::create(&path, options).unwrap();
            let topics: Vec<_> = types()
                .iter()
                .map(|(n, t)| writer.add_topic(n, t, &offered_qos_profiles(Topic::Tf.info().qos)).unwrap())
                .collect();
            for (topic, log, publish, sequence, cdr) in &given {
                let sample = Sample {
                    log_time: Timestamp(*log),
                    publish_time: Timestamp(*publish),
                    sequence: (*sequence).into(),
                    cdr,
                };
                writer.write(topics[*topic], sample).unwrap();
            }
            let metadata = writer.finish().unwrap();
            prop_assert_eq!(metadata.message_count, expected.len() as u64);
            let reader = BagReader::open(&path).unwrap();
            prop_assert!(reader.integrity().complete);
            prop_assert_eq!(reader.message_count(), expected.len() as u64);
            prop_assert_eq!(reader.topics().len(), 5);
            prop_assert_eq!(reader.bounds().map(|b| (b.0.0, b.1.0)), expected.first().map(|f| (f.1, expected.last().unwrap().1)));
            let read: Vec<_> = reader
                .messages()
                .map(|m| {
                    let m = m.unwrap();
                    let topic = types().iter().position(|(n, t)| *n == m.topic.name && *t == m.topic.type_name).unwrap();
                    (topic, m.log_time.0, m.publish_time.0, m.sequence, m.cdr)
                })
                .collect();
            prop_assert_eq!(&read, &expected);
            given = read;
        }
    }
}

#[test]
fn messages_decode_and_topics_are_recognised() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    unfinished(&path, BagOptions::default(), 250).0.finish().unwrap();
    let reader = BagReader::open(&path).unwrap();
    let topic = reader.topic("/whorl_1/attitude/estimate").unwrap();
    assert_eq!(topic.whorl_topic(), Some((Some("whorl_1"), Topic::AttitudeEstimate)));
    for (i, message) in reader.messages().enumerate() {
        let message = message.unwrap();
        // By its encoding, because it holds a NaN.
        assert_eq!(encoded(&message.decode().unwrap()), encoded(&estimate(i as u64)));
    }
    // A single file is a bag too.
    assert_eq!(BagReader::open(&path.join("bag_0.mcap")).unwrap().message_count(), 250);
}

#[test]
fn topics_and_times_are_selected() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let (mut writer, _) = unfinished(&path, BagOptions::default(), 250);
    let other = writer.add_topic("/other", "x_msgs/msg/Y", "").unwrap();
    writer.write(other, sample(100, &[0, 1, 0, 0])).unwrap();
    writer.finish().unwrap();
    let reader = BagReader::open(&path).unwrap();
    let other: Vec<_> = reader.messages_of(&["/other"]).map(Result::unwrap).collect();
    assert_eq!(other.len(), 1);
    assert!(
        matches!(other[0].decode(), Err(BagError::UnknownType { type_name, .. }) if type_name == "x_msgs/msg/Y")
    );
    assert_eq!(reader.messages_of(&["/absent"]).count(), 0);
    assert_eq!(reader.messages_of::<&str>(&[]).count(), 0);
    let select = |from, until| {
        let filter = MessageFilter { topics: None, from: Some(time(from)), until: Some(time(until)) };
        reader.select(filter).map(|m| m.unwrap().log_time).collect::<Vec<_>>()
    };
    let times = select(99, 102);
    assert_eq!(times, [time(99), time(100), time(100), time(101)]);
    assert_eq!(select(20, 20).len(), 0);
    assert_eq!(select(21, 20).len(), 0);
}

#[test]
fn the_metadata_is_the_one_that_rosbag2_writes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let mut writer = BagWriter::create(&path, BagOptions::default()).unwrap();
    let qos = offered_qos_profiles(Topic::ImuRaw.info().qos);
    let topic = writer.add_topic("/whorl_1/imu/data_raw", "sensor_msgs/msg/Imu", &qos).unwrap();
    writer
        .write(
            topic,
            Sample { log_time: Timestamp(5), publish_time: Timestamp(4), sequence: 1, cdr: &[0, 1, 0, 0] },
        )
        .unwrap();
    writer.finish().unwrap();
    let expected = r#"rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 0
  starting_time:
    nanoseconds_since_epoch: 5
  message_count: 1
  topics_with_message_count:
    - topic_metadata:
        name: "/whorl_1/imu/data_raw"
        type: "sensor_msgs/msg/Imu"
        serialization_format: "cdr"
        offered_qos_profiles:
          - history: keep_last
            depth: 10
            reliability: best_effort
            durability: volatile
            deadline:
              sec: 9223372036
              nsec: 854775807
            lifespan:
              sec: 9223372036
              nsec: 854775807
            liveliness: automatic
            liveliness_lease_duration:
              sec: 9223372036
              nsec: 854775807
            avoid_ros_namespace_conventions: false
        type_description_hash: ""
      message_count: 1
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - "bag_0.mcap"
  files:
    - path: "bag_0.mcap"
      starting_time:
        nanoseconds_since_epoch: 5
      duration:
        nanoseconds: 0
      message_count: 1
  custom_data: ~
  ros_distro: ""
"#;
    assert_eq!(std::fs::read_to_string(path.join("metadata.yaml")).unwrap(), expected);
}

#[test]
fn misuse_is_a_typed_error_and_recording_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let (mut writer, topic) = unfinished(&path, BagOptions::default(), 1);
    assert!(matches!(BagWriter::create(&path, BagOptions::default()), Err(BagError::Exists { .. })));
    assert!(matches!(
        writer.add_topic("/whorl_1/attitude/estimate", "sensor_msgs/msg/Imu", ""),
        Err(BagError::TypeConflict { .. })
    ));
    let before = Sample { log_time: Timestamp(-1), ..sample(1, &[]) };
    assert!(matches!(writer.write(topic, before), Err(BagError::BeforeEpoch { time_ns: -1, .. })));
    assert!(matches!(
        writer.write(crate::TopicHandle(9), sample(1, &[])),
        Err(BagError::UnknownTopic { index: 9 })
    ));
    writer.write(topic, sample(1, &[0, 1, 0, 0])).unwrap();
    assert_eq!(writer.finish().unwrap().message_count, 2);
}
