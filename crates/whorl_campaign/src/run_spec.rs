//! Specification of one run of a campaign.

use std::path::PathBuf;

use whorl_params::Override;

/// One run.
#[derive(Debug, Clone)]
pub struct RunSpec {
    /// Its number, from 0.
    pub index: u64,
    /// Name of its experiment.
    pub experiment: String,
    /// Seed of its noise.
    pub seed: u64,
    /// Label of each axis.
    pub labels: Vec<String>,
    /// Parameter files, lowest layer first.
    pub layers: Vec<PathBuf>,
    /// Overrides of the files' parameters.
    pub overrides: Vec<Override>,
}
