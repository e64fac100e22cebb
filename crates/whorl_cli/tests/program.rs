//! The command, as a shell starts it. Cargo builds it because of this test: `tests/support/binaries.rs` relies on that.

use std::process::{Command, Output};

fn whorl(arguments: &[&str]) -> Output {
    #[allow(clippy::unwrap_used, reason = "a test fails by panicking")]
    Command::new(env!("CARGO_BIN_EXE_whorl")).args(arguments).output().unwrap()
}

#[test]
fn help_lists_the_commands() {
    let help = whorl(&["--help"]);
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(help.status.success());
    for command in ["simulate", "diagnose", "adopt", "reproduce", "report"] {
        assert!(text.contains(&format!("\n  {command} ")), "{text}");
    }
}

#[test]
fn an_experiment_that_does_not_exist_is_an_error_in_words() {
    let refused = whorl(&["simulate", "--experiment", "/no/such/experiment.yaml"]);
    let text = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{text}");
    assert!(text.starts_with("error: ") && text.contains("/no/such/experiment.yaml"), "{text}");
}

#[test]
fn an_unknown_command_is_wrong_usage() {
    assert_eq!(whorl(&["no_such_command"]).status.code(), Some(2));
}
