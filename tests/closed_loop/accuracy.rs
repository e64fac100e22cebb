//! How well the follower points relative to the leader, by the truth.

use crate::support::machine::Load;
use crate::support::measured;
use crate::support::simulation::{parameters, rms, simulate};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

/// RMS of the relative pointing error over the holds of an experiment, several seeds together [deg]: eight from
/// `first_seed` on where slow tests run, else two.
fn hold_error_deg(experiment: &str, layers: &[&str], first_seed: u64) -> f64 {
    let _share = Load::Computation.take();
    let tree = parameters(&PLATFORMS, experiment, layers);
    let mut all = Vec::new();
    let mut by_seed = Vec::new();
    for seed in first_seed..first_seed + whorl_tests::repetitions(2, 8) {
        let run = simulate(&tree, seed, 600.0);
        assert!(run.finished, "{experiment}, seed {seed}: {:?}", run.lines.last());
        let errors = run.relative_errors_in_hold();
        by_seed.push(rms(&errors).to_degrees());
        all.extend(errors);
    }
    let together = rms(&all).to_degrees();
    measured(&format!(
        "{experiment}: relative pointing error in hold {together:.4} deg RMS; by seed {by_seed:.4?}"
    ));
    together
}

#[test]
fn wheels_hold_the_follower_within_a_twentieth_of_a_degree() {
    let wheels = "/**/local_control: {ros__parameters: {actuators: wheels}}";
    let error = hold_error_deg("leader_follower", &[wheels], 1);
    assert!(error <= 0.05, "{error} deg");
}

#[test]
fn wheels_unloaded_by_jets_hold_as_well() {
    let error = hold_error_deg("leader_follower", &[], 11);
    assert!(error <= 0.05, "{error} deg");
}

#[test]
fn jets_alone_hold_the_follower_within_a_seventh_of_a_degree() {
    let error = hold_error_deg("leader_follower_jets", &[], 1);
    assert!(error <= 0.15, "{error} deg");
}
