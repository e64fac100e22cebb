//! Why a recording could not be written or read.

use std::path::{Path, PathBuf};

use thiserror::Error;

/// Errors of bags and run directories. Every one names the file it is about.
#[derive(Debug, Error)]
pub enum BagError {
    /// The operating system refused.
    #[error("{action} {}: {source}", path.display())]
    Io {
        /// What was tried, e.g. `cannot open`.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The disk, the quota or the largest file size is used up. Recording has stopped; everything up to
    /// the last complete chunk is in the file and readable.
    #[error(
        "no space left to write {}, beside the {} MB that are kept to close the recording: it has stopped, and what was recorded \
         before is readable",
        path.display(), crate::storage::Reserve::BYTES >> 20
    )]
    DiskFull {
        /// The file that did not fit.
        path: PathBuf,
        /// Bytes of complete chunks in the file.
        bytes_kept: u64,
    },
    /// The writer stopped after an earlier error and takes no more messages.
    #[error("recording to {} stopped earlier after an error", path.display())]
    Stopped {
        /// The file.
        path: PathBuf,
    },
    /// Another process is writing the file.
    #[error("{} is being recorded at this moment", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// Nothing there.
    #[error("{} {said}", path.display())]
    NotFound {
        /// The path.
        path: PathBuf,
        /// "does not exist", and what may help.
        said: String,
    },
    /// The target of a recording holds files already.
    #[error("{} exists already: choose another name, or remove it", path.display())]
    Exists {
        /// The path.
        path: PathBuf,
    },
    /// A directory without `metadata.yaml` and without `.mcap` files.
    #[error("{} is not a bag: it holds neither metadata.yaml nor a .mcap file", path.display())]
    NotABag {
        /// The directory.
        path: PathBuf,
    },
    /// A bag in another storage format.
    #[error(
        "{} is stored {}, and only mcap can be read: convert it with \
         `ros2 bag convert -i {} -o <file>` where <file> says `output_bags: [{{uri: <new directory>, storage_id: mcap, all_topics: true}}]`, \
         or with `rosbags-convert --src {} --dst <new directory> --dst-storage mcap` (pip install rosbags)",
        path.display(),
        if storage.is_empty() { "in a format that its metadata.yaml does not name".to_owned() } else { format!("as {storage}") },
        path.display(), path.display()
    )]
    Storage {
        /// The bag.
        path: PathBuf,
        /// Its storage identifier, e.g. `sqlite3`.
        storage: String,
    },
    /// `metadata.yaml` or `manifest.yaml` cannot be understood.
    #[error("{}: {reason}", path.display())]
    Metadata {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Not an MCAP file, or a damaged one.
    #[error("{} is not a readable MCAP file: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: mcap::McapError,
    },
    /// More than is read of a file that somebody else wrote.
    #[error(
        "{}: {what} has {} MB; allowed: up to {} MB. A file with smaller chunks, as `ros2 bag convert` writes it, is read",
        path.display(), bytes.div_ceil(1 << 20), allowed >> 20
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is too large.
        what: &'static str,
        /// How large it is.
        bytes: u64,
        /// How large it may be.
        allowed: u64,
    },
    /// More messages outside chunks than are listed.
    #[error(
        "{} has more than {allowed} messages outside chunks: `ros2 bag convert` writes them into chunks",
        path.display()
    )]
    TooManyMessages {
        /// The file.
        path: PathBuf,
        /// How many it may have.
        allowed: usize,
    },
    /// A time that a bag cannot hold (they count nanoseconds from the epoch, unsigned).
    #[error("time {time_ns} ns on {topic} lies before the epoch")]
    BeforeEpoch {
        /// The topic.
        topic: String,
        /// The time.
        time_ns: i64,
    },
    /// A handle of another writer.
    #[error("topic number {index} was not added to this recording")]
    UnknownTopic {
        /// The handle's number.
        index: usize,
    },
    /// One topic, two types.
    #[error(
        "topic {topic} is recorded as {}, not as {}",
        or_unknown(known, "of an unknown type"),
        or_unknown(offered, "of an unknown type")
    )]
    TypeConflict {
        /// The topic.
        topic: String,
        /// The type it was added with.
        known: String,
        /// The type it was added with now.
        offered: String,
    },
    /// A route whose platform is not in the list of platforms.
    #[error("platform number {platform} is not one of the {count} platforms of this run")]
    UnknownPlatform {
        /// Index of the platform.
        platform: u16,
        /// How many there are.
        count: usize,
    },
    /// A message of a type that Whorl does not know.
    #[error(
        "{topic} carries {}, which this program cannot decode",
        or_unknown(type_name, "messages whose type was not stored")
    )]
    UnknownType {
        /// The topic.
        topic: String,
        /// The type.
        type_name: String,
    },
    /// Bytes that do not match the message type stated in the bag.
    #[error("message on {topic} at {log_time_ns} ns: {source}")]
    Decode {
        /// The topic.
        topic: String,
        /// Log time of the message.
        log_time_ns: i64,
        /// What is wrong.
        source: whorl_msgs::cdr::CdrError,
    },
    /// The thread that writes has ended.
    #[error("the recording had to stop")]
    Background,
    /// A message that cannot be encoded.
    #[error("message for {topic}: {source}")]
    Encode {
        /// The topic.
        topic: String,
        /// What is wrong.
        source: whorl_msgs::cdr::CdrError,
    },
}

/// The text, or what stands for an empty one.
fn or_unknown<'a>(text: &'a str, unknown: &'a str) -> &'a str {
    if text.is_empty() { unknown } else { text }
}

impl BagError {
    /// Nothing there.
    pub(crate) fn not_found(path: &Path) -> Self {
        Self::NotFound { path: path.to_owned(), said: whorl_params::missing(path) }
    }

    /// Wraps an I/O error, telling a full disk from the rest by its kind.
    pub(crate) fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        match source.kind() {
            std::io::ErrorKind::NotFound => Self::not_found(path),
            _ => Self::Io { action, path: path.to_owned(), source },
        }
    }

    /// For `map_err` on calls that read MCAP.
    pub(crate) fn mcap(path: &Path) -> impl FnOnce(mcap::McapError) -> Self + '_ {
        move |source| match source {
            mcap::McapError::Io(source) => Self::io("cannot read", path, source),
            source => Self::Mcap { path: path.to_owned(), source },
        }
    }

    /// Whether the cause is a disk, quota or file size limit that was reached.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        match self {
            Self::DiskFull { .. } => true,
            Self::Io { source, .. } => is_disk_full(source),
            _ => false,
        }
    }
}

/// Whether the operating system says that there is no room.
pub(crate) fn is_disk_full(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}
