//! Imports between the files of a Python package, those in functions and for type checkers among them.

use std::path::{Path, PathBuf};

use super::circles::Imports;

/// `text` gives what a file holds.
pub fn imports(files: &[PathBuf], text: &dyn Fn(&Path) -> String) -> Imports {
    let mut imports = Imports::new();
    for from in files {
        for (k, line) in text(from).lines().enumerate() {
            for name in imported(line) {
                let to = from.with_file_name(format!("{name}.py"));
                if files.contains(&to) && to != *from {
                    let place = format!("{}:{}: {}", from.display(), k + 1, line.trim());
                    let of_file = imports.entry(from.display().to_string()).or_default();
                    of_file.entry(to.display().to_string()).or_insert(place);
                }
            }
        }
    }
    imports
}

/// Names of modules beside it that a line imports: `from .a import b`, `from . import a, b as c`.
fn imported(line: &str) -> Vec<&str> {
    let Some((from, names)) =
        line.trim_start().strip_prefix("from .").and_then(|rest| rest.split_once(" import "))
    else {
        return Vec::new();
    };
    if !from.is_empty() {
        return vec![from.split('.').next().unwrap_or_default()];
    }
    names.split(',').filter_map(|name| name.trim_matches(['(', ')', ' ']).split(' ').next()).collect()
}
