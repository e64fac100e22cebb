//! The recorder's parameters.

use std::path::PathBuf;
use std::time::Duration;

use whorl_bag::{BagOptions, Compression};
use whorl_params::{Reader, formation, range};

use crate::RecordedTopic;

/// Validated parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// Names of the platforms.
    pub platforms: Vec<String>,
    /// Run directories are created in here.
    pub out_directory: PathBuf,
    /// The run directory; `None`: a new one in `out_directory`, named after time and experiment.
    pub run_directory: Option<PathBuf>,
    /// Name of the experiment; `None`: the coordinator's.
    pub experiment: Option<String>,
    /// Commit that the programs were built from.
    pub git_commit: Option<String>,
    /// Seed of the simulated hardware.
    pub seed: Option<u64>,
    /// How the bag is written.
    pub bag: BagOptions,
    /// Topics of other programs.
    pub extra_topics: Vec<RecordedTopic>,
}

/// The single definition of the recorder's parameters. `None` when they are incomplete: the reader then
/// holds the reasons.
pub fn read(r: &mut Reader<'_>) -> Option<Parameters> {
    let platforms = formation(r).platforms;
    r.fixed(|r| {
        let out_directory = r.string_or("out_directory", "runs", "where run directories are created");
        let run_directory = r.optional_string(
            "run_directory",
            "the run directory; without it a new one in out_directory, named after time and experiment",
        );
        let experiment = r.optional_string(
            "experiment",
            "name of the run; without it the coordinator's experiment.name, or else `recording`",
        );
        let git_commit = r.optional_string("git_commit", "commit that the programs were built from");
        let seed = r.optional_i64("seed", range(0..), "seed of the simulated hardware, for the manifest");
        let age_s = r.f64_or(
            "max_chunk_age_s",
            0.5,
            range(0.05..=1.0),
            "a recorder that is killed loses at most this much [s]",
        );
        let max_chunk_bytes = r.i64_or(
            "max_chunk_bytes",
            BagOptions::default().max_chunk_bytes as i64,
            range(4_096..=2_097_152),
            "a chunk is written when it holds this many bytes",
        );
        let max_file_age_s = r.f64_or(
            "max_file_age_s",
            600.0,
            range(1.0..=86_400.0),
            "the bag's next file begins when one is this long [s]; a file's index stays in memory until it is complete",
        );
        let compression = r.choice_or("compression", "none", &["none", "lz4"], "compression of the bag");
        let extra = r.string_array_or("extra_topics", &[], "further topics, each `/TOPIC PACKAGE/msg/TYPE`");
        let mut extra_topics = Vec::new();
        for text in &extra {
            match RecordedTopic::parse(text) {
                Ok(topic) => extra_topics.push(topic),
                Err(problem) => r.reject("extra_topics", problem),
            }
        }
        Some(Parameters {
            platforms,
            out_directory: PathBuf::from(out_directory),
            run_directory: run_directory.map(PathBuf::from),
            experiment,
            git_commit,
            seed: seed.and_then(|seed| u64::try_from(seed).ok()),
            bag: BagOptions {
                compression: if compression == "lz4" { Compression::Lz4 } else { Compression::None },
                max_chunk_bytes: usize::try_from(max_chunk_bytes).ok()?,
                max_chunk_age: Duration::from_secs_f64(age_s),
                max_file_age: Some(Duration::from_secs_f64(max_file_age_s)),
            },
            extra_topics,
        })
    })
}
