//! Same seed, same run, to the bit.

use crate::support::machine::Load;
use crate::support::simulation::{parameters, simulate};

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let _share = Load::Light.take();
    // Loss and jitter too are drawn from the seed.
    let link = "/simulation: {ros__parameters: {link: {delay_s: 0.01, jitter_s: 0.01, loss: 0.05}}}";
    let tree = parameters(&["whorl_1", "whorl_2"], "leader_follower_short", &[link]);
    let bytes = |seed| simulate(&tree, seed, 60.0).bytes();
    let first = bytes(7);
    assert!(first.len() > 1_000_000, "{} bytes", first.len());
    // Not `assert_eq`: it would print megabytes.
    assert!(first == bytes(7), "the same seed gave another run");
    assert!(first != bytes(8), "another seed gave the same run");
}
