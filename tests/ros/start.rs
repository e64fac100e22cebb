//! Invalid configurations are refused at the start, with a message that names the cause.

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};

/// Starts a node that must refuse; returns its message.
fn refusal(node: &str, layers: &[&str], overrides: &[&str]) -> String {
    let mut formation = Formation::new(&["whorl_1"], &[&[LONG_HOLD_ALONE], layers].concat());
    let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
    formation.start_with(node, &overrides);
    let status = formation.node(node).wait(STARTUP);
    let log = formation.node(node).log();
    assert!(!status.success(), "{node} started:\n{log}");
    log
}

fn assert_names(log: &str, words: &[&str]) {
    for word in words {
        assert!(log.contains(word), "`{word}` is not in:\n{log}");
    }
}

#[test]
fn a_wrong_parameter_is_refused_with_file_line_key_value_and_what_is_allowed() {
    let layer = "/**/estimator:\n  ros__parameters:\n    tf_rate_hz: 5000.0\n    tf_rat_hz: 1.0\n";
    let log = refusal("/whorl_1/estimator", &[layer], &[]);
    assert_names(&log, &["layer_1.yaml:3", "tf_rate_hz", "5000", "0 to 100"]);
    // All errors at once; an unknown key with the nearest one that exists.
    assert_names(&log, &["layer_1.yaml:4", "tf_rat_hz", "tf_rate_hz"]);
}

#[test]
fn an_impossible_inertia_is_refused() {
    let layer =
        "/whorl_1/**:\n  ros__parameters:\n    model:\n      inertia_kg_m2: {xx: 1.0, yy: 1.0, zz: 12.1}\n";
    let log = refusal("/whorl_1/local_control", &[layer], &[]);
    assert_names(&log, &["inertia"]);
}

#[test]
fn hardware_without_drivers_names_the_missing_device() {
    let log = refusal("/whorl_1/driver", &[], &["backend:=hardware"]);
    assert_names(&log, &["/dev/whorl/"]);
}

#[test]
fn a_platform_that_is_not_in_the_formation_is_refused() {
    let log = refusal("/whorl_1/driver", &[], &["formation.platforms:=[whorl_7]"]);
    assert_names(&log, &["whorl_1", "whorl_7"]);
}

#[test]
fn a_recording_that_does_not_exist_is_refused() {
    let log = refusal("/whorl_1/driver", &[], &["backend:=replay", "replay.source:=/no/such/run"]);
    assert_names(&log, &["/no/such/run"]);
}
