//! Why a run could not be read.

use std::path::PathBuf;

use thiserror::Error;
use whorl_bag::BagError;
use whorl_params::ParameterErrors;

/// Errors of reading runs and models. Each says what is wrong and, where something can be done, what helps.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The run directory or bag cannot be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// The parameters cannot be read.
    #[error(transparent)]
    Parameters(#[from] ParameterErrors),
    /// No measurement of any platform.
    #[error(
        "{}: there are no measurements of a platform in it: needed is one of <platform>/imu/data_raw \
         (sensor_msgs/Imu) and <platform>/wheels/state (sensor_msgs/JointState); it has {present}. If other \
         topics hold them, say which in a topic map: channels.yaml in the bag's folder", path.display()
    )]
    NoMeasurements {
        /// The run.
        path: PathBuf,
        /// The topics that there are.
        present: String,
    },
    /// The platform that was asked for is not in the run.
    #[error("{}: there is no platform {platform} in it; there is: {present}", path.display())]
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
         in them: look at the driver's log, or record again", path.display()
    )]
    NothingFinite {
        /// The run.
        path: PathBuf,
        /// The platform.
        platform: String,
        /// How many messages there are.
        messages: usize,
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
    /// No model in parameter files.
    #[error("{}: there is no platform model in it (group `model`); {hint}", path.display())]
    NoModel {
        /// Parameter file or run.
        path: PathBuf,
        /// What helps.
        hint: String,
    },
}
