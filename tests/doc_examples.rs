//! Examples in documentation comments are compiled: in crates that say `doctest = false` there must be none.

use std::path::{Path, PathBuf};

use crate::support::root;

/// Rust files of a folder and its folders.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Whether a documentation comment holds a block that rustdoc takes for Rust.
fn has_example(text: &str) -> bool {
    let mut inside = false;
    for line in text.lines().map(str::trim_start) {
        let Some(comment) = line.strip_prefix("//!").or_else(|| line.strip_prefix("///")) else {
            inside = false;
            continue;
        };
        if let Some(language) = comment.trim().strip_prefix("```") {
            let other = ["text", "yaml", "bash", "sh", "console", "json", "csv", "toml"].contains(&language);
            if !inside && !other {
                return true;
            }
            inside = !inside;
        }
    }
    false
}

#[test]
fn crates_without_doc_tests_have_no_examples() {
    assert!(has_example("/// ```\n/// let x = 1;\n/// ```\n") && has_example("//! ```no_run\n"));
    assert!(!has_example("//! ```text\n//! x\n//! ```\nfn f() {}\n/// ```yaml\n/// a: 1\n/// ```\n"));
    let members = ["crates", "nodes"].map(|folder| root().join(folder));
    let mut folders: Vec<PathBuf> =
        members.iter().flat_map(|f| std::fs::read_dir(f).unwrap()).map(|e| e.unwrap().path()).collect();
    folders.extend([root().join("msgs"), root().join("tests/challenge")]);
    let mut without = 0;
    for folder in folders {
        let Ok(manifest) = std::fs::read_to_string(folder.join("Cargo.toml")) else { continue };
        if !manifest.contains("doctest = false") {
            continue;
        }
        without += 1;
        let mut files = Vec::new();
        sources(&folder.join("src"), &mut files);
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            assert!(!has_example(&text), "{}: remove `doctest = false` from its Cargo.toml", file.display());
        }
    }
    assert!(without > 10, "{without} crates without doc tests");
}
