//! Helpers for the tests of all crates. The integration tests themselves are in `integration.rs`.

mod domain;

pub use domain::Domain;

use std::io::Write;

/// Prints, also when the test passes, that something was not tested here.
pub fn skipped(what: &str, why: &str) {
    // Straight to the handle: libtest keeps what the macros print of tests that pass.
    let _ = writeln!(std::io::stderr(), "\nSKIPPED {what}: {why}");
}
