//! A small fixed part of the challenge: fails when the score falls.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use std::sync::Arc;

use whorl_challenge::cases::build::{Stand, stand_key};
use whorl_challenge::cases::{Laboratory, Spec, all_specs, build};
use whorl_challenge::score::{Outcome, judge};

fn specs(keys: &[&str]) -> Vec<Spec> {
    let all = all_specs(1, false);
    keys.iter()
        .map(|key| all.iter().find(|s| s.key() == *key).unwrap_or_else(|| panic!("no {key}")).clone())
        .collect()
}

fn answer(laboratory: &Laboratory, stand: &Arc<Stand>, spec: &Spec) -> Outcome {
    let built = build(laboratory, stand, spec).unwrap_or_else(|e| panic!("{}: {e}", spec.key()));
    // The case has the stated detectability, whatever the diagnosis finds.
    if spec.lambda > 0 {
        let ratio = built.answer.lambda / f64::from(spec.lambda);
        assert!((0.6..1.7).contains(&ratio), "{}: detectability off by {ratio}", spec.key());
    }
    let outcome = judge(&built, 2);
    println!(
        "{}: {} {:?}, detectability {:.0}, {:.1} s",
        outcome.key, outcome.verdict, outcome.answer, outcome.lambda, outcome.seconds
    );
    outcome
}

fn answers(laboratory: &Laboratory, keys: &[&str]) -> Vec<Outcome> {
    // The keys share platform and runs.
    let specs = specs(keys);
    let stand = Arc::new(Stand::new(laboratory, &stand_key(&specs[0]), &specs[0]));
    let outcomes: Vec<Outcome> = specs.iter().map(|spec| answer(laboratory, &stand, spec)).collect();
    for outcome in &outcomes {
        assert!(outcome.error.is_none(), "{}: {:?}", outcome.key, outcome.error);
        assert!(!outcome.wrong_name, "{}: {} {:?}", outcome.key, outcome.verdict, outcome.answer);
    }
    outcomes
}

#[test]
#[ignore = "slow: a friction and a sensor of the challenge"]
fn a_friction_and_a_sensor_are_named() {
    let laboratory = Laboratory::whorl_1().unwrap();
    let keys = ["single/bearing_coulomb_friction/100/0", "single/gyro_scale/100/0"];
    for outcome in answers(&laboratory, &keys) {
        assert!(outcome.exact, "{}: {} {:?}", outcome.key, outcome.verdict, outcome.answer);
    }
}

#[test]
#[ignore = "slow: cases of the challenge without an effect"]
fn nothing_is_named_where_nothing_is_missing_also_with_a_controller_running() {
    let laboratory = Laboratory::whorl_1().unwrap();
    for key in ["control/none/0/0", "closed_loop/none/0/0"] {
        for outcome in answers(&laboratory, &[key]) {
            assert_eq!(outcome.verdict, "nothing_missing", "{}", outcome.key);
        }
    }
}

#[test]
#[ignore = "slow: cases of the challenge that no library has"]
fn what_no_library_has_is_unknown() {
    let laboratory = Laboratory::whorl_1().unwrap();
    let keys = ["outside/gear/1000/0", "outside/bursting_leak/1000/0", "outside/dead_gyro/1000/0"];
    for outcome in answers(&laboratory, &keys) {
        assert_eq!(outcome.unknown_right, Some(true), "{}: {:?}", outcome.key, outcome.answer);
        assert_eq!(outcome.variable_right, Some(true), "{:?}", outcome.unknown_variable);
    }
}

#[test]
fn cases_are_the_same_every_time_and_sealed() {
    let laboratory = Laboratory::whorl_1().unwrap();
    let spec = specs(&["bench/wheel_friction/200/0"]).remove(0);
    let make = || {
        let stand = Arc::new(Stand::new(&laboratory, &stand_key(&spec), &spec));
        build(&laboratory, &stand, &spec).unwrap()
    };
    let (first, second) = (make(), make());
    assert_eq!(first.answer.seal(), second.answer.seal());
    assert_eq!(first.training, second.training);
    let wheel = first.training[0].wheel_speed_rad_s.value.first().unwrap().len();
    assert_eq!(wheel, 3);
    assert!(first.training[0].gyro_b_rad_s.is_empty(), "a clamped platform has nothing but its wheels");
}
