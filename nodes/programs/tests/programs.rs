//! The programs, as a shell starts them. Cargo builds them because of these tests: `tests/support/binaries.rs` relies on that.

#![allow(clippy::panic, reason = "a test fails by panicking")]

use std::path::Path;
use std::process::{Command, Output, Stdio};

#[test]
fn coordinator_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_coordinator"), "coordinator", None);
}

#[test]
fn driver_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_driver"), "driver", Some("whorl_1"));
}

#[test]
fn estimator_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_estimator"), "estimator", Some("whorl_1"));
}

#[test]
fn local_control_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_local_control"), "local_control", Some("whorl_1"));
}

#[test]
fn model_monitor_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_model_monitor"), "model_monitor", Some("whorl_1"));
}

#[test]
fn recorder_says_what_it_is_and_refuses_a_wrong_parameter() {
    node_answers_the_shell(env!("CARGO_BIN_EXE_recorder"), "recorder", None);
}

/// Fails unless a node's program describes itself, and refuses a parameter that does not exist with file, line and key
/// before it joins a network. `platform` is that of the node, if it belongs to one.
fn node_answers_the_shell(program: &str, name: &str, platform: Option<&str>) {
    let run = |arguments: &[&str]| -> Output {
        let output = Command::new(program).args(arguments).env_remove("RUST_LOG").output();
        output.unwrap_or_else(|error| panic!("{program}: {error}"))
    };
    let help = run(&["--help"]);
    let text = String::from_utf8_lossy(&help.stdout);
    assert!(help.status.success() && text.starts_with(&format!("{name}: ")), "{help:?}");
    assert!(text.contains("--params-file FILE"), "{text}");
    assert_eq!(code_without_a_reader(program, &["--help"]), Some(0), "--help into a closed pipe");
    assert_eq!(
        code_without_a_reader(program, &["--ros-args", "--no-such-option"]),
        Some(2),
        "a refusal into a closed pipe"
    );

    let parameters = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let wrong = Path::new(program).with_file_name(format!("wrong_parameter_of_{name}.yaml"));
    let written = std::fs::write(&wrong, "/**:\n  ros__parameters:\n    no_such_parameter: 1.0\n");
    assert!(written.is_ok(), "{}: {written:?}", wrong.display());
    let mut arguments = vec!["--ros-args".to_owned()];
    for file in ["common.yaml", "whorl_1.yaml", "truth/whorl_1.yaml"] {
        arguments.extend(["--params-file".to_owned(), parameters.join(file).display().to_string()]);
    }
    arguments.extend(["--params-file".to_owned(), wrong.display().to_string()]);
    arguments.extend(["-p".to_owned(), "formation.platforms:=[whorl_1]".to_owned()]);
    arguments.extend(platform.into_iter().flat_map(|p| ["-r".to_owned(), format!("__ns:=/{p}")]));
    let refused = run(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let text = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{text}");
    for words in [format!("wrong_parameter_of_{name}.yaml:3"), "no_such_parameter".to_owned()] {
        assert!(text.contains(&words), "`{words}` is not in:\n{text}");
    }
}

/// Exit code of a program that nobody listens to: both of its outputs are closed pipes, as in `driver --help | head -1`.
fn code_without_a_reader(program: &str, arguments: &[&str]) -> Option<i32> {
    let closed = || -> Stdio {
        let (reader, writer) = std::io::pipe().unwrap_or_else(|error| panic!("no pipe: {error}"));
        drop(reader);
        writer.into()
    };
    let status = Command::new(program).args(arguments).stdout(closed()).stderr(closed()).status();
    status.unwrap_or_else(|error| panic!("{program}: {error}")).code()
}
