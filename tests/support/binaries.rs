//! The programs under test.
//!
//! `cargo test --workspace` builds them beside the tests, because each program's package has a test that starts it. Where
//! only these tests are built, the programs are built here; with a build of their own, since cargo chooses fewer features
//! of the dependencies when no tests are built.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use whorl_node::Node;

use super::root;

/// Every program that a formation or a user starts.
fn programs() -> impl Iterator<Item = &'static str> {
    let nodes = Node::ALL.iter().filter(|node| node.info().is_program).map(|node| node.name());
    nodes.chain(["whorl"])
}

/// Folder of the node binaries and `whorl`, built with the profile of this test.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        std::env::var_os("WHORL_TEST_BIN").map(PathBuf::from).unwrap_or_else(|| {
            // <target>/<profile>/deps/integration-<hash>
            let test = std::env::current_exe().unwrap();
            let folder = test.parent().and_then(Path::parent).unwrap().to_owned();
            if !programs().all(|name| is_current(&folder, name)) {
                build(&folder);
            }
            folder
        })
    })
}

/// The path of one program.
pub fn path(name: &str) -> PathBuf {
    let path = folder().join(name);
    assert!(path.is_file(), "{} has not been built", path.display());
    path
}

/// Whether a program is there and no older than what it was made of, which cargo lists in `<name>.d`.
fn is_current(folder: &Path, name: &str) -> bool {
    let changed = |path: &Path| path.metadata().and_then(|m| m.modified()).ok();
    let sources = std::fs::read_to_string(folder.join(format!("{name}.d"))).unwrap_or_default();
    let Some((_, sources)) = sources.split_once(": ") else { return false };
    let Some(built) = changed(&folder.join(name)) else { return false };
    split_at_spaces(sources.trim_end()).iter().all(|path| changed(path).is_some_and(|at| at <= built))
}

/// The paths of a list for make, in which a space of a name follows a backslash.
fn split_at_spaces(list: &str) -> Vec<PathBuf> {
    list.replace("\\ ", "\0")
        .split(' ')
        .filter(|path| !path.is_empty())
        .map(|path| PathBuf::from(path.replace('\0', " ")))
        .collect()
}

fn build(folder: &Path) {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .args(["build", "--workspace", "--bins", "--locked", "--target-dir"])
        .arg(folder.parent().unwrap())
        .current_dir(root());
    if cfg!(feature = "security") {
        cargo.args(["--features", "security"]);
    }
    match folder.file_name().and_then(|n| n.to_str()) {
        // As the tests themselves.
        Some("debug") => cargo.args(["--profile", "test"]),
        Some(name) => cargo.args(["--profile", name]),
        None => panic!("no profile in {}", folder.display()),
    };
    let output = cargo.output().unwrap();
    assert!(output.status.success(), "{cargo:?} failed:\n{}", String::from_utf8_lossy(&output.stderr));
}
