//! How well the follower points relative to the leader, by the truth.

use crate::support::machine::Load;
use crate::support::measured;
use crate::support::simulation::{parameters, rms, simulate};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

/// RMS of the relative pointing error over the holds of an experiment [deg], one per seed.
fn hold_errors_deg(experiment: &str, layers: &[&str], seeds: std::ops::RangeInclusive<u64>) -> Vec<f64> {
    let _share = Load::Light.take();
    let tree = parameters(&PLATFORMS, experiment, layers);
    let errors: Vec<f64> = seeds
        .map(|seed| {
            let run = simulate(&tree, seed, 600.0);
            assert!(run.finished, "{experiment}, seed {seed}: {:?}", run.lines.last());
            rms(&run.relative_errors_in_hold()).to_degrees()
        })
        .collect();
    measured(&format!("{experiment}: relative pointing error in hold, RMS by seed [deg]: {errors:.4?}"));
    errors
}

#[test]
fn wheels_hold_the_follower_within_a_twentieth_of_a_degree() {
    let wheels = "/**/local_control: {ros__parameters: {actuators: wheels}}";
    for error in hold_errors_deg("leader_follower", &[wheels], 1..=5) {
        assert!(error <= 0.05, "{error} deg");
    }
}

#[test]
fn wheels_unloaded_by_jets_hold_as_well() {
    for error in hold_errors_deg("leader_follower", &[], 11..=15) {
        assert!(error <= 0.05, "{error} deg");
    }
}

#[test]
fn jets_alone_hold_the_follower_within_a_seventh_of_a_degree() {
    for error in hold_errors_deg("leader_follower_jets", &[], 1..=5) {
        assert!(error <= 0.15, "{error} deg");
    }
}
