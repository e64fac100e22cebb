//! Run directories and bags as recordings.

use std::path::{Path, PathBuf};

use whorl_dynamics::PlatformModel;

use crate::{Recording, RecordingError};

/// How a run is to be read.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadOptions<'a> {
    /// Only this platform; `None`: all.
    pub platform: Option<&'a str>,
    /// The platform's model, for what a plain bag does not say: the vector sensor's reference direction, the
    /// order of wheels. `None`: the parameters in the run directory, if there are any.
    pub model: Option<&'a PlatformModel>,
    /// Which topic holds what, for bags of other systems. `None`: `channels.yaml` in the bag's folder, if there
    /// is one, and else Whorl's own topics.
    pub channels: Option<&'a Path>,
}

/// Reads the measurements of one platform, or of all, out of a run directory, a rosbag2 directory or an
/// `.mcap` file. One [`Recording`] per platform, in the order of the platforms.
///
/// # Errors
/// What is wrong with the run, and what would help.
pub fn read_run(path: &Path, platform: Option<&str>) -> Result<Vec<Recording>, RecordingError> {
    read_run_with(path, &ReadOptions { platform, ..ReadOptions::default() })
}

/// As [`read_run`], told more.
///
/// # Errors
/// As [`read_run`].
pub fn read_run_with(path: &Path, options: &ReadOptions<'_>) -> Result<Vec<Recording>, RecordingError> {
    let _ = options;
    Err(RecordingError::NoMeasurements { path: PathBuf::from(path), present: String::new() })
}
