//! The programs under test, built once.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use super::root;

/// Folder of the node binaries and `whorl`, built with the profile of this test.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| std::env::var_os("WHORL_TEST_BIN").map_or_else(build, PathBuf::from))
}

/// The path of one program.
pub fn path(name: &str) -> PathBuf {
    let path = folder().join(name);
    assert!(path.is_file(), "{} has not been built", path.display());
    path
}

fn build() -> PathBuf {
    // <target>/<profile>/deps/integration-<hash>
    let test = std::env::current_exe().unwrap();
    let profile = test.parent().and_then(Path::parent).unwrap();
    let target = profile.parent().unwrap();
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--workspace", "--bins", "--locked", "--target-dir"])
        .arg(target)
        .current_dir(root());
    match profile.file_name().and_then(|n| n.to_str()) {
        Some("debug") => {}
        Some(name) => {
            cargo.args(["--profile", name]);
        }
        None => panic!("no profile in {}", test.display()),
    }
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{cargo:?} failed:\n{}", String::from_utf8_lossy(&output.stderr));
    profile.to_owned()
}
