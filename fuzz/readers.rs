//! Everything that reads what others wrote, given any bytes: it refuses them or understands them; it does not panic, and what it
//! understands it can write and read again. For cargo-fuzz (`fuzz_targets/`) and for `tests/fuzz`, which spoils real files.

use std::path::{Path, PathBuf};

use whorl_bag::{BagReader, CsvMap, Manifest, recover};
use whorl_msgs::topics::{Message, MessageType};
use whorl_params::{ParameterTree, Value, effect_yaml, read_effect, set_in_text};
use whorl_recording::{KnownPlatform, read_csv, read_model, read_run};

/// What reads bytes.
pub type Reader = fn(&[u8]);

/// Of every kind of file and message, by the name of its target.
pub const READERS: [(&str, Reader); 6] =
    [("cdr", cdr), ("mcap", mcap), ("csv", csv), ("yaml", yaml), ("map", map), ("manifest", manifest)];

/// A message: its type's number among all types, then its encoding.
pub fn cdr(data: &[u8]) {
    let Some((which, bytes)) = data.split_first() else { return };
    let ty = MessageType::ALL[usize::from(*which) % MessageType::ALL.len()];
    let Ok(message) = Message::decode(ty, bytes) else { return };
    let mut written = Vec::new();
    message.encode_into(&mut written).expect("what was decoded can be encoded");
    // Bytes and not messages: a NaN is not equal to itself.
    let mut again = Vec::new();
    let read = Message::decode(ty, &written).expect("what was encoded can be decoded");
    read.encode_into(&mut again).expect("what was decoded can be encoded");
    assert_eq!(written, again, "{ty:?} changes when it is written");
}

/// The file of a bag, also one whose writer was killed.
pub fn mcap(data: &[u8]) {
    let folder = Scratch::new();
    let bag = folder.file("bag/bag_0.mcap", data);
    let bag = bag.parent().expect("it lies in a folder");
    if let Ok(reader) = BagReader::open(bag) {
        for message in reader.messages() {
            let Ok(message) = message else { break };
            let _ = message.decode();
        }
    }
    let _ = read_run(bag, None);
    if recover(bag).is_ok() {
        let whole = BagReader::open(bag).expect("what was recovered opens");
        assert!(whole.integrity().complete, "what was recovered is not whole");
    }
}

/// A CSV file, by a map that reads a column of every kind.
pub fn csv(data: &[u8]) {
    let folder = Scratch::new();
    let known = platform();
    let parts = whorl_recording::platform_parts(&known);
    let map = CsvMap::load_for(&folder.file("map.yaml", MAP.as_bytes()), &parts).expect("the map is one");
    let _ = read_csv(&folder.file("log.csv", data), &map, &known);
}

/// Parameters of nodes, a platform, an effect.
pub fn yaml(data: &[u8]) {
    let folder = Scratch::new();
    let file = folder.file("file.yaml", data);
    let _ = read_model(&file, None);
    if let Ok(effect) = read_effect(&file) {
        let text = effect_yaml(effect.definition(), "");
        let again = read_effect(&folder.file("again/file.yaml", text.as_bytes()))
            .expect("what was written can be read");
        assert_eq!(again.definition(), effect.definition(), "an effect changes when it is written");
    }
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(tree) = ParameterTree::from_texts(&[("file.yaml", text)], &[]) {
        let _ = tree.for_node("/whorl_1/estimator");
        let edited =
            set_in_text("file.yaml", text, "/whorl_1/driver", "model.mass_kg", &Value::Double(1.5), None);
        if let Ok(edited) = edited {
            ParameterTree::from_texts(&[("file.yaml", &edited)], &[]).expect("what was edited can be read");
        }
    }
}

/// A map of columns, and a file that is read by it.
pub fn map(data: &[u8]) {
    let folder = Scratch::new();
    let known = platform();
    if let Ok(map) =
        CsvMap::load_for(&folder.file("map.yaml", data), &whorl_recording::platform_parts(&known))
    {
        let _ = read_csv(&folder.file("log.csv", b"t,x,y,z\n0,1,2,3\n1,2,3,4\n"), &map, &known);
    }
}

/// The manifest of a run.
pub fn manifest(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let path = Path::new("manifest.yaml");
    let Ok(manifest) = Manifest::from_yaml(path, text) else { return };
    let written = manifest.to_yaml();
    let again = Manifest::from_yaml(path, &written).expect("what was written can be read");
    assert_eq!(again.to_yaml(), written, "a manifest changes when it is written");
}

/// Columns of every kind.
pub const MAP: &str = "csv:
  ros__parameters:
    time: {column: t, unit: ms}
    gyro: {columns: [x, -y, z], unit: deg/s}
    accelerometer: {columns: [a, b, c], unit: g}
    vector: {columns: [u, v, w]}
    wheel_speed: {columns: [n1, n2, n3], unit: rpm}
    jets:
      columns: [j1, j2, j3, j4, j5, j6, j7, j8, j9, j10, j11, j12]
      quantity: duty
      slot_length_s: 0.1
    bus_voltage: {column: volt, unit: V}
    true_attitude: {columns: [qw, qx, qy, qz], rotation: body_to_world}
";

/// The platform that comes with the sources.
fn platform() -> KnownPlatform {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../params/whorl_1.yaml");
    read_model(&path, None).expect("the platform is one")
}

/// A folder that goes when it is no longer needed.
struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn file(&self, name: &str, content: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).expect("a folder");
        }
        std::fs::write(&path, content).expect("a file");
        path
    }
}
