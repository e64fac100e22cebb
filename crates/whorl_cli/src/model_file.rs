//! Changes of a model, written into its parameter file.

use std::path::Path;

use whorl_params::ModelStep;
use whorl_params::changes::Change;
use whorl_recording::KnownPlatform;

/// Writes the changes into an existing file and notes them there as the next step of the model's history, with today's
/// date. Returns how many entries were written.
pub fn write_step(
    file: &Path,
    known: &KnownPlatform,
    changes: &[Change],
    step: ModelStep,
) -> anyhow::Result<usize> {
    whorl_commands::model_file::write_step(file, known, changes, step, whorl_ros::wall_clock())
}
