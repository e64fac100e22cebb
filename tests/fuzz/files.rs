//! Files that were cut off, hit by bit errors or written by something else: bags, CSV, parameter files, manifests. What reads
//! them answers or says what is wrong; nothing panics, hangs, or asks for memory out of proportion to the file.

use std::path::Path;

use whorl_bag::{
    BagOptions, BagReader, CsvMap, CsvRows, Manifest, PlatformParts, RawSample, RunDescription, RunDirectory,
    RunWriter,
};
use whorl_msgs::topics::MessageType;
use whorl_node::Timestamp;
use whorl_params::ParameterTree;
use whorl_recorder::RecordedTopic;
use whorl_tests::repetitions;

use super::START;
use super::generator::Generator;

/// A file of some kilobytes may make its reader ask for this much: chunks are decompressed whole.
const MEMORY: u64 = 64 << 20;

/// How often each kind of file is spoilt.
fn rounds() -> usize {
    repetitions(300, 10_000)
}

/// Reads `original`, then many spoilt copies of it, which `read` may refuse; at least one of them must be read and one
/// refused, or the test shows nothing.
fn any_bytes(what: &str, original: &[u8], mut read: impl FnMut(&[u8]) -> bool) {
    assert!(read(original), "{what}: the file as it was written");
    let mut generator = Generator::new(0xF11E);
    let mut taken = 0;
    for round in 0..rounds() {
        let spoilt = generator.spoil(original);
        let mut answer = false;
        let counted = allocation_counter::measure(|| answer = read(&spoilt));
        assert!(counted.bytes_max < MEMORY, "{what}, round {round}: {} bytes at once", counted.bytes_max);
        taken += usize::from(answer);
    }
    assert!(0 < taken && taken < rounds(), "{what}: {taken} of {} taken", rounds());
}

/// A run of a few seconds with every topic.
fn run(folder: &Path) -> RunDirectory {
    let platforms = ["whorl_1".to_owned()];
    let description = RunDescription { platforms: platforms.to_vec(), ..RunDescription::default() };
    let path = folder.join("run");
    let mut run = RunWriter::create_in(&path, description, START, BagOptions::default()).unwrap();
    let mut generator = Generator::new(3);
    let topics = RecordedTopic::all_of(&platforms);
    let handles: Vec<_> =
        topics.iter().map(|topic| run.add_topic(&topic.name, &topic.type_name, "", None).unwrap()).collect();
    for step in 0..200 {
        let index = step % topics.len();
        let kind = topics[index].route.map_or(MessageType::Imu, |r| r.topic.info().message_type);
        let now = Timestamp(START.0 + i64::try_from(step).unwrap() * 10_000_000);
        let mut cdr = Vec::new();
        generator.message(kind, now).encode_into(&mut cdr).unwrap();
        run.write_raw(
            handles[index],
            RawSample { log_time: now, publish_time: now, origin: None, cdr: &cdr },
        )
        .unwrap();
    }
    run.finish(START).unwrap();
    RunDirectory::open(&path).unwrap()
}

#[test]
fn any_bag_is_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path());
    let bag = run.path().join("bag/bag_0.mcap");
    let original = std::fs::read(bag).unwrap();
    let copy = folder.path().join("copy.mcap");
    any_bytes("a bag", &original, |bytes| {
        std::fs::write(&copy, bytes).unwrap();
        let Ok(reader) = BagReader::open(&copy) else { return false };
        let mut whole = reader.integrity().complete;
        for message in reader.messages() {
            whole &= message.is_ok_and(|m| m.topic.message_type().is_none() || m.decode().is_ok());
        }
        whole
    });
}

#[test]
fn any_manifest_is_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let original = run(folder.path()).manifest_or_from_bag().unwrap().to_yaml();
    any_bytes("a manifest", original.as_bytes(), |bytes| {
        Manifest::from_yaml(Path::new("manifest.yaml"), &String::from_utf8_lossy(bytes)).is_ok()
    });
}

#[test]
fn any_parameter_file_is_read_or_refused() {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("../params");
    for file in ["common.yaml", "whorl_1.yaml", "experiments/leader_follower.yaml"] {
        let original = std::fs::read(params.join(file)).unwrap();
        any_bytes(file, &original, |bytes| {
            let text = String::from_utf8_lossy(bytes);
            let Ok(tree) = ParameterTree::from_texts(&[(file, &text)], &[]) else { return false };
            // What was read is also written and read again.
            let again = tree.effective_yaml();
            ParameterTree::from_texts(&[("again", &again)], &[]).unwrap();
            true
        });
    }
}

#[test]
fn any_csv_is_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.yaml");
    let text = "csv:\n  ros__parameters:\n    time: {column: t, unit: s}\n    gyro: {columns: [x, y, z], unit: deg/s}\n    \
                bus_voltage: {column: v, unit: V}\n    closed_loop: false\n";
    std::fs::write(&map, text).unwrap();
    let parts = PlatformParts { platform: "whorl_1".to_owned(), wheels: Vec::new(), jets: Vec::new() };
    let map = CsvMap::load_for(&map, &parts).unwrap();
    let mut original = "t,x,y,z,v\n".to_owned();
    for line in 0..200 {
        let t = f64::from(line) * 0.01;
        original += &format!(
            "{t:.2},{:.6},{:.6},-1e-3,{}\n",
            t.sin(),
            t.cos(),
            if line % 10 == 0 { "24.1" } else { "" }
        );
    }
    let copy = folder.path().join("copy.csv");
    any_bytes("a CSV file", original.as_bytes(), |bytes| {
        std::fs::write(&copy, bytes).unwrap();
        let Ok(mut rows) = CsvRows::open(&copy, &map) else { return false };
        loop {
            match rows.next_row() {
                Ok(Some(row)) => assert!(row.numbers.values().flatten().all(|x| x.is_finite())),
                Ok(None) => return true,
                Err(_) => return false,
            }
        }
    });
}
