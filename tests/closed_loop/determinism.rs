//! Same seed, same run, to the bit.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::machine::Load;
use crate::support::simulation::{parameters, simulate};
use crate::support::{binaries, root};

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let _share = Load::Computation.take();
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

/// What the command writes, by path in the run directory.
fn command(out: &Path, seed: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut whorl = Command::new(binaries::path("whorl"));
    whorl.args(["simulate", "--seed", seed, "--experiment"]);
    whorl.arg(root().join("params/experiments/leader_follower_short.yaml")).arg("--out").arg(out);
    let output = whorl.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut files = BTreeMap::new();
    let mut folders = vec![out.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(out).unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    files
}

#[test]
fn whorl_simulate_writes_the_same_files_from_the_same_seed() {
    let _share = Load::Computation.take();
    let folder = tempfile::tempdir().unwrap();
    let first = command(&folder.path().join("first"), "3");
    let again = command(&folder.path().join("again"), "3");
    let other = command(&folder.path().join("other"), "4");
    assert!(first.keys().eq(again.keys()), "{:?} and {:?}", first.keys(), again.keys());
    let bag = Path::new("bag/bag_0.mcap");
    assert!(first[bag].len() > 1_000_000, "{} bytes", first[bag].len());
    for (path, bytes) in &first {
        // These three tell when the run was made.
        if !["manifest.yaml", "report.html", "summary.json"].iter().any(|name| path.ends_with(name)) {
            assert!(*bytes == again[path], "{} differs", path.display());
        }
    }
    assert!(first[bag] != other[bag], "another seed gave the same bag");
}
