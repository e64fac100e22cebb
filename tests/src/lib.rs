//! Helpers for the tests of all crates. The integration tests themselves are in `integration.rs`.

mod domain;

pub use domain::Domain;

use std::io::Write;

/// Whether a test that takes long runs: with `WHORL_SLOW_TESTS=1`, which CI sets. Says so when it is left out.
#[must_use]
pub fn slow(what: &str) -> bool {
    let wanted = all();
    if !wanted {
        skipped(what, "it takes long; WHORL_SLOW_TESTS=1 runs it");
    }
    wanted
}

/// How often something is repeated: `all` times where slow tests run, else `few`.
#[must_use]
pub fn repetitions<T>(few: T, all: T) -> T {
    if self::all() { all } else { few }
}

fn all() -> bool {
    std::env::var("WHORL_SLOW_TESTS").is_ok_and(|v| v == "1")
}

/// Prints, also when the test passes, that something was not tested here.
pub fn skipped(what: &str, why: &str) {
    // Straight to the handle: libtest keeps what the macros print of tests that pass.
    let _ = writeln!(std::io::stderr(), "\nSKIPPED {what}: {why}");
}
