//! Bags of other programs, and things that are not bags.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use mcap::records::MessageHeader;
use whorl_msgs::Message;

use crate::{BagError, BagReader, recover};

fn error(path: &Path) -> String {
    BagReader::open(path).err().unwrap().to_string()
}

#[test]
fn what_is_not_a_bag_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path();
    assert!(error(&path.join("absent")).ends_with("absent does not exist"));
    assert!(error(path).ends_with("is not a bag: it holds neither metadata.yaml nor a .mcap file"));
    std::fs::write(path.join("text.mcap"), "no magic here").unwrap();
    assert!(error(path).contains("text.mcap is not a readable MCAP file: Bad magic number"));
    std::fs::write(path.join("metadata.yaml"), "a: [").unwrap();
    assert!(error(path).contains("metadata.yaml: "));
    std::fs::write(path.join("metadata.yaml"), "a: 1").unwrap();
    assert!(error(path).contains("no rosbag2_bagfile_information"));
    let metadata = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths: [x.db3]\n";
    std::fs::write(path.join("metadata.yaml"), metadata).unwrap();
    assert!(matches!(BagReader::open(path), Err(BagError::Storage { storage, .. }) if storage == "sqlite3"));
    assert!(error(path).contains("ros2 bag convert"));
    std::fs::write(path.join("metadata.yaml"), metadata.replace("sqlite3", "mcap")).unwrap();
    assert!(matches!(BagReader::open(path), Err(BagError::NotFound { path, .. }) if path.ends_with("x.db3")));
    let wrapped = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  compression_mode: FILE\n  relative_file_paths: [text.mcap]\n";
    std::fs::write(path.join("metadata.yaml"), wrapped).unwrap();
    assert!(error(path).contains("compression_mode FILE"));
    std::fs::remove_file(path.join("metadata.yaml")).unwrap();
    std::fs::remove_file(path.join("text.mcap")).unwrap();
    std::fs::write(path.join("x.db3"), "").unwrap();
    assert!(matches!(BagReader::open(path), Err(BagError::Storage { .. })));
    assert!(matches!(BagReader::open(&path.join("x.db3")), Err(BagError::Storage { .. })));
}

/// As `ros2 bag record --storage-preset-profile fastwrite`: no chunks; in two files; one topic with two
/// channels. With and without an end.
#[test]
fn split_bags_without_chunks_are_read() {
    for complete in [true, false] {
        let directory = tempfile::tempdir().unwrap();
        for file in 0..2u64 {
            let path = directory.path().join(format!("x_{file}.mcap"));
            let options = mcap::WriteOptions::new().profile("ros2").use_chunks(false);
            let mut writer = options.create(File::create(&path).unwrap()).unwrap();
            let schema = writer.add_schema("std_msgs/msg/Header", "ros2msg", b"string frame_id").unwrap();
            let channels: Vec<u16> = ["- history: 1", "- history: 3"]
                .iter()
                .map(|qos| {
                    let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), (*qos).to_owned())]);
                    writer.add_channel(schema, "/a", "cdr", &metadata).unwrap()
                })
                .collect();
            for i in 0..10u64 {
                // Within a file the times run backwards.
                let log_time = file * 100 + 9 - i;
                let header = MessageHeader {
                    channel_id: channels[(i % 2) as usize],
                    sequence: 0,
                    log_time,
                    publish_time: log_time,
                };
                writer.write_to_known_channel(&header, &[log_time as u8]).unwrap();
            }
            writer.finish().unwrap();
            if !complete {
                let length = std::fs::metadata(&path).unwrap().len();
                // Into the summary section: footer and magic are 37 bytes, the statistics more than 20.
                File::options().write(true).open(&path).unwrap().set_len(length - 60).unwrap();
            }
        }
        let expected: Vec<u8> = (0..10).chain(100..110).collect();
        for round in 0..2 {
            let reader = BagReader::open(directory.path()).unwrap();
            assert_eq!((reader.topics().len(), reader.message_count()), (1, 20));
            assert_eq!(reader.integrity().complete, complete || round == 1);
            let read: Vec<u8> = reader.messages().map(|m| m.unwrap().cdr[0]).collect();
            assert_eq!(read, expected);
            assert_eq!(recover(directory.path()).unwrap().files, if complete || round == 1 { 0 } else { 2 });
        }
    }
}

/// Written by the Python implementation, see `data/zstd.py`; also with its end cut off.
#[test]
fn zstandard_chunks_are_read() {
    let bytes = include_bytes!("data/zstd.mcap");
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("zstd.mcap");
    for cut in [0, 60, 3_000] {
        std::fs::write(&path, &bytes[..bytes.len() - cut]).unwrap();
        let reader = BagReader::open(&path).unwrap();
        assert_eq!(reader.integrity().complete, cut == 0);
        assert_eq!(reader.integrity().damaged_chunks, 0);
        let messages: Vec<_> = reader.messages().map(Result::unwrap).collect();
        assert_eq!(messages.len() as u64, reader.message_count());
        assert!(if cut < 3_000 { messages.len() == 300 } else { messages.len() < 300 });
        for (i, message) in messages.iter().enumerate() {
            let Message::Vector3Stamped(point) = message.decode().unwrap() else { panic!() };
            assert_eq!((point.header.stamp.sec, point.header.stamp.nanosec), (i as i32, 5));
            assert_eq!((point.header.frame_id.as_str(), point.vector.x), ("world", i as f64 * 0.5));
            assert_eq!((message.log_time.0, message.sequence), (i as i64 * 1000, i as u32));
        }
    }
}

/// Every error with every text empty: a sentence has no hole.
#[test]
fn no_error_has_an_empty_blank_in_it() {
    let path = || Path::new("a").to_owned();
    let text = String::new;
    let all: Vec<String> = vec![
        BagError::Storage { path: path(), storage: text() }.to_string(),
        BagError::UnknownType { topic: "/a".into(), type_name: text() }.to_string(),
        BagError::TypeConflict { topic: "/a".into(), known: text(), offered: text() }.to_string(),
        BagError::NotABag { path: path() }.to_string(),
        BagError::UnknownPlatform { platform: 1, count: 0 }.to_string(),
        crate::CsvError::MissingColumn { path: path(), column: "t".into(), present: text() }.to_string(),
        crate::CsvError::NotANumber { path: path(), line: 1, column: "t".into(), text: text(), hint: "" }
            .to_string(),
        crate::CsvError::Empty { path: path() }.to_string(),
    ];
    for said in all {
        for hole in [": ;", ": ,", " ,", " ;", " :", "  ", "``", "( ", "()", "as and", "as ,", "are:  "] {
            assert!(!said.contains(hole), "{hole:?} in {said}");
        }
        assert!(!said.trim_end().ends_with(':'), "{said}");
    }
}
