//! Files and programs of a computer.

use std::path::PathBuf;
use std::process::{Command, Stdio};

/// What a program said.
pub(super) type Answer = Option<String>;

/// A computer that can be asked.
pub(super) struct Machine {
    /// Folder of its root: `/`.
    pub(super) root: PathBuf,
    /// The standard output of a program; `None` when it is not there or failed.
    pub(super) run: fn(&str, &[&str]) -> Answer,
}

impl Machine {
    /// The computer that this runs on.
    pub(super) fn this() -> Self {
        Self { root: PathBuf::from("/"), run }
    }

    /// The text of a file, without the end of its line.
    pub(super) fn text(&self, path: &str) -> Option<String> {
        let text = std::fs::read_to_string(self.root.join(path.trim_start_matches('/'))).ok()?;
        Some(text.trim_end().to_owned())
    }

    /// A number that is alone in a file.
    pub(super) fn number(&self, path: &str) -> Option<f64> {
        self.text(path)?.trim().parse().ok().filter(|x: &f64| x.is_finite())
    }

    /// Names in a folder, sorted.
    pub(super) fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.root.join(folder.trim_start_matches('/')));
        let names = entries.into_iter().flatten().flatten();
        let mut names: Vec<String> = names.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }
}

fn run(program: &str, arguments: &[&str]) -> Answer {
    // Programs of administrators are not on everybody's path.
    let path = std::env::var("PATH").unwrap_or_default();
    let mut command = Command::new(program);
    command.args(arguments).env("PATH", format!("{path}:/usr/sbin:/sbin")).env("LC_ALL", "C");
    let output = command.stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}
