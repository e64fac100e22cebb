//! Why a run could not be read.

use std::path::{Path, PathBuf};

use thiserror::Error;
use whorl_bag::{BagError, CsvError};
use whorl_math::words::or_did_you_mean;
use whorl_params::ParameterErrors;

/// Errors of reading runs and models. Each says what is wrong and, where something can be done, what helps.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The run directory or bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The CSV file or its map is wrong.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// The operating system refused.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The parameters cannot be read.
    #[error(transparent)]
    Parameters(#[from] ParameterErrors),
    /// No measurement of any platform.
    #[error(
        "{}: there are no measurements of a platform in it: needed is one of <platform>/imu/data_raw \
         (sensor_msgs/Imu) and <platform>/wheels/state (sensor_msgs/JointState); it has {}. If other \
         topics hold them, say which in a topic map: --channels FILE, or channels.yaml in the bag's folder (docs/recordings.md shows \
         one)", path.display(), or_none(present)
    )]
    NoMeasurements {
        /// The run.
        path: PathBuf,
        /// The topics that there are.
        present: String,
    },
    /// A bag in which nothing can be read.
    #[error(
        "{}: nothing in it can be read: {reason}", path.display()
    )]
    NothingInBag {
        /// The bag.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Messages that are not of the type that their topic is read as.
    #[error(
        "{}: the recorder stored no type for {topic}, and its {messages} messages are not {expected}: say in the map what they are",
        path.display()
    )]
    OtherMessages {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// How many messages there are.
        messages: usize,
        /// What the map implies.
        expected: &'static str,
    },
    /// Several publishers of one topic.
    #[error("{}: {topic}: {reason}", path.display())]
    SeveralPublishers {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// What shows it, and what helps.
        reason: String,
    },
    /// The map names a joint that messages do not have.
    #[error("{}: no joint is called {joint}, as the topic map says; there are: {}", path.display(), or_none(present))]
    NoSuchJoint {
        /// The run.
        path: PathBuf,
        /// What the map says.
        joint: String,
        /// The joints that there are.
        present: String,
    },
    /// The platform that was asked for is not in the run.
    #[error(
        "{}: there is no platform {platform} in it; there is: {}{}", path.display(), or_none(present),
        or_did_you_mean(platform, present.split(", "))
    )]
    NoSuchPlatform {
        /// The run.
        path: PathBuf,
        /// What was asked for.
        platform: String,
        /// The platforms that there are.
        present: String,
    },
    /// Messages, but not one finite number in them.
    #[error(
        "{}: {platform} has {messages} messages of gyro, accelerometer and wheels, and not one finite number \
         in them: look at the driver's log, or record again{}{said}", path.display(), if said.is_empty() { "" } else { ". " }
    )]
    NothingFinite {
        /// The run.
        path: PathBuf,
        /// The platform.
        platform: String,
        /// How many messages there are.
        messages: usize,
        /// What was noticed on reading.
        said: String,
    },
    /// A CSV file without a number in the columns that count.
    #[error(
        "{}: {rows} lines, and not one has a number in every column of gyro, accelerometer or wheel_speed: is the \
         map that of this file?", path.display()
    )]
    NothingInCsv {
        /// The file.
        path: PathBuf,
        /// Lines with a time.
        rows: u64,
    },
    /// Implausible times.
    #[error(
        "{}: from the first to the last line it is {length_s:.0} s: is the time column's unit right?", path.display()
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// From first to last line \[s\].
        length_s: f64,
    },
    /// A vector sensor without a reference direction.
    #[error(
        "{}: vector sensor {sensor}: the direction that it sees in the world is not known: give reference_world in \
         the map", path.display()
    )]
    NoReferenceWorld {
        /// The file.
        path: PathBuf,
        /// Its number, from 1.
        sensor: usize,
    },
    /// Samples in memory that are no samples of their channel.
    #[error("{channel}: {reason}")]
    Samples {
        /// Name of the channel, with the number of its sensor.
        channel: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// The model of another platform.
    #[error(
        "the run {run} is of a platform with {counted}, and the model {model} has {expected}: is it the model of another platform?"
    )]
    OtherPlatform {
        /// Name of the run.
        run: String,
        /// What was counted in the run, e.g. `4 wheels`.
        counted: String,
        /// Name of the model's platform.
        model: String,
        /// What the model has.
        expected: String,
    },
    /// Models of several platforms, and none was chosen.
    #[error("{}: it holds the models of {}: choose one with --platform", path.display(), or_none(&present.join(" and ")))]
    SeveralModels {
        /// Parameter file or run.
        path: PathBuf,
        /// The platforms that there are.
        present: Vec<String>,
    },
    /// No model in parameter files.
    #[error("{}: there is no platform model in it (group `model`); {hint}", path.display())]
    NoModel {
        /// Parameter file or run.
        path: PathBuf,
        /// What helps.
        hint: String,
    },
}

/// A list, or a word for an empty one.
pub(crate) fn or_none(list: &str) -> &str {
    if list.trim().is_empty() { "nothing" } else { list }
}

impl RecordingError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }
}
