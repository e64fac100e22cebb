//! Files whose writer was killed, and damaged files.

use std::time::Duration;

use proptest::prelude::*;

use super::{time, unfinished};
use crate::{BagError, BagOptions, BagReader, recover};

/// Chunks of a tenth of a second: ten messages.
fn options() -> BagOptions {
    BagOptions { max_chunk_age: Duration::from_millis(100), ..BagOptions::default() }
}

#[test]
fn a_killed_recording_loses_less_than_the_age_of_a_chunk() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let (writer, _) = unfinished(&path, options(), 1007);
    // What a killed process leaves: the file as it is now, and no destructor.
    let reader = BagReader::open(&path).unwrap();
    assert_eq!(reader.message_count(), 1000);
    assert!(!reader.integrity().complete);
    assert!(matches!(recover(&path), Err(BagError::InUse { .. })));
    std::mem::forget(writer);
}

#[test]
fn a_recording_killed_in_its_third_file_is_made_complete() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let options = BagOptions { max_file_age: Some(Duration::from_secs(2)), ..options() };
    let (writer, _) = unfinished(&path, options, 507);
    let counts = |reader: &BagReader| (reader.message_count(), reader.messages().count());
    let reader = BagReader::open(&path).unwrap();
    assert_eq!((counts(&reader), reader.integrity().complete), ((500, 500), false));
    // What a killed process leaves: the files as they are now, and no lock.
    let left = directory.path().join("left");
    std::fs::create_dir(&left).unwrap();
    for name in ["metadata.yaml", "bag_0.mcap", "bag_1.mcap", "bag_2.mcap"] {
        std::fs::copy(path.join(name), left.join(name)).unwrap();
    }
    drop(writer);
    let recovery = recover(&left).unwrap();
    assert_eq!((recovery.files, recovery.messages), (1, 100));
    let reader = BagReader::open(&left).unwrap();
    assert_eq!((counts(&reader), reader.integrity().complete), ((500, 500), true));
    let text = std::fs::read_to_string(left.join("metadata.yaml")).unwrap();
    assert_eq!(text.matches("message_count: 200").count(), 2, "{text}");
    assert_eq!(text.matches("message_count: 100").count(), 1, "{text}");
    assert_eq!(text.matches("message_count: 500").count(), 2, "{text}");
}

#[test]
fn the_clock_flushes_when_no_more_messages_come() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let (mut writer, _) = unfinished(&path, options(), 7);
    let count = || BagReader::open(&path).unwrap().message_count();
    assert_eq!(count(), 0);
    writer.tick(time(0)).unwrap();
    writer.tick(time(9)).unwrap();
    assert_eq!(count(), 0);
    writer.tick(time(10)).unwrap();
    assert_eq!(count(), 7);
    std::mem::forget(writer);
}

/// A complete file of 200 messages, the length of the file after each flush, and how many messages each
/// length holds.
fn file_with_known_boundaries() -> (Vec<u8>, Vec<(usize, u64)>) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag");
    let mut boundaries = Vec::new();
    let (mut writer, topic) = unfinished(&path, options(), 0);
    for sequence in 0..200 {
        let bytes = super::encoded(&super::estimate(sequence));
        writer.write(topic, super::sample(sequence, &bytes)).unwrap();
        if sequence % 10 == 9 {
            writer.flush().unwrap();
            boundaries.push((writer.bytes_written() as usize, sequence + 1));
        }
    }
    writer.finish().unwrap();
    (std::fs::read(path.join("bag_0.mcap")).unwrap(), boundaries)
}

/// A file cut at `length`: opens, reads, recovers, and reads the same again as a complete bag.
fn check_cut(bytes: &[u8], length: usize, boundaries: &[(usize, u64)]) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bag_0.mcap");
    std::fs::write(&path, &bytes[..length]).unwrap();
    let flushed =
        boundaries.iter().filter(|(end, _)| *end <= length).map(|(_, count)| *count).max().unwrap_or(0);
    if length < 8 {
        assert!(matches!(BagReader::open(directory.path()), Err(BagError::Mcap { .. })));
        return;
    }
    let read = |path: &std::path::Path| {
        let reader = BagReader::open(path).unwrap();
        (
            reader.messages().map(|m| m.unwrap()).map(|m| (m.log_time, m.cdr)).collect::<Vec<_>>(),
            reader.integrity(),
        )
    };
    let (messages, integrity) = read(directory.path());
    // A cut within the index behind a chunk loses nothing of the chunk.
    assert!(
        (flushed..=flushed + 10).contains(&(messages.len() as u64)),
        "{length}: {flushed} {}",
        messages.len()
    );
    assert_eq!(integrity.damaged_chunks, 0);
    let recovery = recover(directory.path()).unwrap();
    assert_eq!(recovery.files, usize::from(!integrity.complete));
    let (again, complete) = read(directory.path());
    assert!(complete.complete && again == messages);
    assert_eq!(recover(directory.path()).unwrap().files, 0);
}

#[test]
fn cut_at_and_around_every_boundary() {
    let (bytes, boundaries) = file_with_known_boundaries();
    assert_eq!(boundaries.len(), 20);
    for &(end, _) in &boundaries {
        for length in [end - 1, end, end + 1, end + 9] {
            check_cut(&bytes, length, &boundaries);
        }
    }
    for length in (0..40).chain(bytes.len() - 40..=bytes.len()) {
        check_cut(&bytes, length, &boundaries);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn cut_anywhere(fraction in 0.0f64..1.0) {
        let (bytes, boundaries) = file_with_known_boundaries();
        check_cut(&bytes, (fraction * bytes.len() as f64) as usize, &boundaries);
    }

    /// Bytes that are wrong, anywhere, are an error or a smaller bag, never a panic, and never more messages.
    #[test]
    fn wrong_bytes_anywhere(
        wrong in proptest::collection::vec((0.0f64..1.0, any::<u8>()), 1..20),
        cut in 0.1f64..2.0,
    ) {
        let (mut bytes, _) = file_with_known_boundaries();
        for (place, value) in wrong {
            let place = (place * bytes.len() as f64) as usize;
            bytes[place] = value;
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("bag_0.mcap"), bytes).unwrap();
        for _ in 0..2 {
            if let Ok(reader) = BagReader::open(directory.path()) {
                prop_assert!(reader.messages().filter_map(Result::ok).count() <= 200);
            }
            let _ = recover(directory.path());
        }
    }
}
