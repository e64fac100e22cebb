//! What is known of a platform before its data are explained.

use std::path::{Path, PathBuf};

use whorl_dynamics::{ModelPrior, PlatformModel};

use crate::RecordingError;

/// A platform's model and how well it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownPlatform {
    /// Name of the platform.
    pub platform: String,
    /// The model that estimator and control use.
    pub model: PlatformModel,
    /// Standard deviations of the model's parameters.
    pub prior: ModelPrior,
    /// The files it was read from, lowest layer first.
    pub files: Vec<PathBuf>,
}

/// Reads the model of a platform: from a parameter file (layered on `common.yaml` beside it, if there is
/// one), or from the parameters saved in a run directory. `platform` may be left out where there is only one.
///
/// # Errors
/// What is wrong with the parameters, with file, line and key; or [`RecordingError::NoModel`].
pub fn read_model(source: &Path, platform: Option<&str>) -> Result<KnownPlatform, RecordingError> {
    let _ = platform;
    Err(RecordingError::NoModel { path: source.to_owned(), hint: String::new() })
}
