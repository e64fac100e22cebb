//! Tests of the crate as a whole.

mod bad_messages;
mod bad_runs;
mod contradictions;
mod csv;
mod damages;
mod digits;
mod foreign_bags;
mod memory;
mod refusals;
mod robot_bags;
mod round_trip;
mod simulated_run;
mod usable;

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use crate::{KnownPlatform, read_model};

/// The parameter files of the repository.
fn parameters() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params")
}

/// Whorl-I, read once.
fn whorl_1() -> KnownPlatform {
    static KNOWN: LazyLock<KnownPlatform> =
        LazyLock::new(|| read_model(&parameters().join("whorl_1.yaml"), None).unwrap());
    KNOWN.clone()
}
