//! `metadata.yaml` of rosbag2, version 9.

use std::path::{Path, PathBuf};

use whorl_msgs::{MessageType, Topic};

use crate::BagError;
use crate::compression::ZSTANDARD;
use crate::unpacked::is_packed;
use crate::yaml::{self, YamlWriter};

/// One topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagTopic {
    /// Full topic name.
    pub name: String,
    /// ROS type, `package/msg/Type`.
    pub type_name: String,
    /// Encoding of the messages; `cdr` in every ROS 2 bag.
    pub encoding: String,
    /// Quality of service of its writers, YAML as rosbag2 stores it; may be empty.
    pub offered_qos_profiles: String,
    /// Number of messages.
    pub message_count: u64,
}

impl BagTopic {
    /// Its type, if Whorl knows it.
    #[must_use]
    pub fn message_type(&self) -> Option<MessageType> {
        (self.encoding == "cdr")
            .then(|| MessageType::ALL.iter().copied().find(|t| t.name() == self.type_name))
            .flatten()
    }

    /// Which of Whorl's topics this is, and of which platform: `/whorl_1/imu/data_raw` is
    /// `(Some("whorl_1"), Topic::ImuRaw)`, `/tf` is `(None, Topic::Tf)`. `None` for any other topic, or when
    /// its type is not the topic's.
    #[must_use]
    pub fn whorl_topic(&self) -> Option<(Option<&str>, Topic)> {
        let name = self.name.strip_prefix('/')?;
        let (platform, topic) = match Topic::find(name, false) {
            Some(topic) => (None, topic),
            None => {
                let (platform, name) = name.split_once('/')?;
                (Some(platform), Topic::find(name, true)?)
            }
        };
        (self.message_type() == Some(topic.info().message_type)).then_some((platform, topic))
    }
}

/// One file of a bag.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BagFile {
    /// Its name in the bag's directory.
    pub name: String,
    /// Log times of its first and its last message \[ns\]; `None` when there is none.
    pub bounds_ns: Option<(u64, u64)>,
    /// Number of messages.
    pub message_count: u64,
}

/// What `metadata.yaml` says about the whole bag.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BagMetadata {
    /// Log time of the first message \[ns\]; 0 when there is none.
    pub start_ns: u64,
    /// Log time of the last message \[ns\]; 0 when there is none.
    pub end_ns: u64,
    /// Number of messages.
    pub message_count: u64,
    /// Topics in the order in which they were added.
    pub topics: Vec<BagTopic>,
    /// Files in the order in which they were begun.
    pub files: Vec<BagFile>,
}

/// Name of the metadata file in a bag directory.
pub const METADATA_FILE: &str = "metadata.yaml";

impl BagMetadata {
    /// What is in these files together.
    pub(crate) fn new(topics: Vec<BagTopic>, files: Vec<BagFile>) -> Self {
        let (start_ns, end_ns) =
            files.iter().filter_map(|file| file.bounds_ns).reduce(both).unwrap_or_default();
        let message_count = files.iter().map(|file| file.message_count).sum();
        Self { start_ns, end_ns, message_count, topics, files }
    }

    /// The file's text.
    #[must_use]
    pub fn to_yaml(&self) -> String {
        let duration = self.end_ns.saturating_sub(self.start_ns);
        let mut root = YamlWriter::default();
        root.group("rosbag2_bagfile_information", |y| {
            y.raw("version", 9);
            y.raw("storage_identifier", "mcap");
            y.group("duration", |y| y.raw("nanoseconds", duration));
            y.group("starting_time", |y| y.raw("nanoseconds_since_epoch", self.start_ns));
            y.raw("message_count", self.message_count);
            y.list("topics_with_message_count", &self.topics, |y, topic| {
                y.group("topic_metadata", |y| {
                    y.text("name", &topic.name);
                    y.text("type", &topic.type_name);
                    y.text("serialization_format", &topic.encoding);
                    if topic.offered_qos_profiles.is_empty() {
                        y.raw("offered_qos_profiles", "[]");
                    } else {
                        y.block("offered_qos_profiles", &topic.offered_qos_profiles);
                    }
                    // Hashes need the type descriptions of rosidl; an empty one means "not known".
                    y.text("type_description_hash", "");
                });
                y.raw("message_count", topic.message_count);
            });
            y.text("compression_format", "");
            y.text("compression_mode", "");
            let names: Vec<&str> = self.files.iter().map(|file| file.name.as_str()).collect();
            y.scalars("relative_file_paths", &names);
            y.list("files", &self.files, |y, file| {
                let (start_ns, end_ns) = file.bounds_ns.unwrap_or_default();
                y.text("path", &file.name);
                y.group("starting_time", |y| y.raw("nanoseconds_since_epoch", start_ns));
                y.group("duration", |y| y.raw("nanoseconds", end_ns.saturating_sub(start_ns)));
                y.raw("message_count", file.message_count);
            });
            y.raw("custom_data", "~");
            y.text("ros_distro", "");
        });
        root.finish()
    }

    /// Replaces `metadata.yaml` in one step, so that a reader sees the old or the new one.
    pub(crate) fn write(&self, bag: &Path) -> Result<(), BagError> {
        replace_file(&bag.join(METADATA_FILE), self.to_yaml().as_bytes())
    }
}

/// The earlier of two beginnings and the later of two ends.
pub(crate) fn both(a: (u64, u64), b: (u64, u64)) -> (u64, u64) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Replaces a file, see [`whorl_files::write_file`].
pub(crate) fn replace_file(path: &Path, bytes: &[u8]) -> Result<(), BagError> {
    whorl_files::write_file(path, bytes).map_err(|e| BagError::io("cannot write", path, e))
}

/// The `.mcap` files of a bag directory, in order.
pub(crate) fn mcap_files(bag: &Path) -> Result<Vec<PathBuf>, BagError> {
    Ok(files_and_doubt(bag)?.0)
}

/// The `.mcap` files of a bag directory, in order, and why its metadata were not believed: files that are MCAP are read
/// whatever stands beside them.
pub(crate) fn files_and_doubt(bag: &Path) -> Result<(Vec<PathBuf>, Option<String>), BagError> {
    let path = bag.join(METADATA_FILE);
    let wrong = match whorl_files::read_text(&path) {
        Ok(text) => match files_of_metadata(bag, &path, &text) {
            Ok(files) => return Ok((files, None)),
            Err(wrong) => wrong,
        },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            return Ok((files_of_directory(bag)?, None));
        }
        Err(error) => return Err(BagError::io("cannot read", &path, error)),
    };
    let is_file_missing = matches!(&wrong, BagError::NotFound { .. });
    match files_of_directory(bag) {
        Ok(files) if !files.is_empty() && files.iter().all(|file| begins_as_mcap(file)) => {
            // One of several files that is gone is a loss; a file that was given another name is none.
            if is_file_missing && files.iter().any(|file| is_listed(&path, file)) {
                return Err(wrong);
            }
            let reason = match &wrong {
                BagError::Storage { storage, .. } if storage.is_empty() => "it names no storage".to_owned(),
                BagError::Storage { storage, .. } => format!("it says that the storage is {storage}"),
                BagError::Metadata { reason, .. } => reason.clone(),
                BagError::NotFound { path, .. } => format!("{} is not there", path.display()),
                other => other.to_string(),
            };
            let doubt =
                format!("{} is not right ({reason}): the .mcap files beside it were read.", path.display());
            Ok((files, Some(doubt)))
        }
        _ => Err(wrong),
    }
}

fn begins_as_mcap(file: &Path) -> bool {
    if is_packed(file) {
        return true;
    }
    let mut magic = [0; mcap::MAGIC.len()];
    let read =
        std::fs::File::open(file).and_then(|mut file| std::io::Read::read_exact(&mut file, &mut magic));
    read.is_ok() && magic == mcap::MAGIC
}

/// Whether metadata name this file.
fn is_listed(metadata: &Path, file: &Path) -> bool {
    let text = whorl_files::read_text(metadata).unwrap_or_default();
    file.file_name().is_some_and(|name| text.contains(&*name.to_string_lossy()))
}

fn files_of_metadata(bag: &Path, path: &Path, text: &str) -> Result<Vec<PathBuf>, BagError> {
    let wrong = |reason: String| BagError::Metadata { path: path.to_owned(), reason };
    let root = yaml::load(path, text)?;
    let information = yaml::find(&root, &["rosbag2_bagfile_information"]).ok_or_else(|| {
        wrong("there is no rosbag2_bagfile_information: this is not a bag's metadata".into())
    })?;
    let storage =
        yaml::find(information, &["storage_identifier"]).and_then(|v| v.as_str()).unwrap_or_default();
    if storage != "mcap" {
        return Err(BagError::Storage { path: bag.to_owned(), storage: storage.to_owned() });
    }
    let said = |key: &str| yaml::find(information, &[key]).and_then(|v| v.as_str()).unwrap_or_default();
    let (mode, format) = (said("compression_mode"), said("compression_format"));
    if !matches!(mode.to_ascii_lowercase().as_str(), "" | "none") && format != ZSTANDARD {
        return Err(wrong(format!(
            "compression_mode {mode} with the compression_format `{format}`; read is {ZSTANDARD}. `ros2 bag convert -i {} -o <file>` takes it off, where <file> \
             says `output_bags: [{{uri: <new directory>, storage_id: mcap, all_topics: true}}]`",
            bag.display()
        )));
    }
    let names = yaml::find(information, &["relative_file_paths"])
        .and_then(|v| v.as_sequence())
        .ok_or_else(|| wrong("there is no list relative_file_paths".into()))?;
    // Only the file's name counts, as in other readers: bags of before version 4 wrote a longer path.
    let files: Vec<PathBuf> = names
        .iter()
        .filter_map(|name| Path::new(name.as_str()?).file_name())
        // Of compressed files rosbag2 lists the name with the ending, or, in some versions, without.
        .map(|name| match bag.join(name) {
            file if file.exists() => file,
            file => {
                let packed = file.with_extension(format!("mcap.{ZSTANDARD}"));
                if packed.exists() { packed } else { file }
            }
        })
        .collect();
    match files.iter().find(|file| !file.exists()) {
        Some(missing) => Err(BagError::not_found(missing)),
        None if files.is_empty() => Err(wrong("relative_file_paths is empty".into())),
        None => Ok(files),
    }
}

/// Without metadata: every `.mcap` file by name.
fn files_of_directory(bag: &Path) -> Result<Vec<PathBuf>, BagError> {
    let entries = std::fs::read_dir(bag).map_err(|e| BagError::io("cannot read", bag, e))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    let has = |extension: &str| {
        let extension = Some(std::ffi::OsStr::new(extension));
        files.iter().filter(move |f| f.extension() == extension).cloned().collect::<Vec<_>>()
    };
    let stored = |storage: &str, file: &PathBuf| {
        is_packed(file)
            && file.file_stem().is_some_and(|stem| Path::new(stem).extension() == Some(storage.as_ref()))
    };
    let (mut mcap, sqlite) = (has("mcap"), has("db3"));
    mcap.extend(files.iter().filter(|file| stored("mcap", file)).cloned());
    if !mcap.is_empty() {
        Ok(mcap)
    } else if !sqlite.is_empty() || files.iter().any(|file| stored("db3", file)) {
        Err(BagError::Storage { path: bag.to_owned(), storage: "sqlite3".into() })
    } else {
        Err(BagError::NotABag { path: bag.to_owned() })
    }
}
