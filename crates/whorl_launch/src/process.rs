//! What is started.

use std::ffi::OsString;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use whorl_node::Node;

use crate::error::LaunchError;

/// A process to start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Process {
    /// Distinguishes it from all others of this machine and domain: `whorl_1_driver`, `recorder`.
    pub label: String,
    /// Which node it is.
    pub node: Node,
    /// Its arguments.
    pub arguments: Vec<OsString>,
}

/// The folder that the programs are in.
#[derive(Debug, Clone)]
pub struct Programs(PathBuf);

impl Programs {
    /// The folder of this program: all are built together.
    ///
    /// # Errors
    /// When the operating system does not say where this program is.
    pub fn beside_this_one() -> Result<Self, LaunchError> {
        let own = std::env::current_exe().map_err(LaunchError::io("cannot find", "this program"))?;
        Ok(Self(own.parent().map_or_else(PathBuf::new, Path::to_owned)))
    }

    /// Programs that are somewhere else.
    #[cfg(test)]
    pub(crate) fn in_folder(folder: &Path) -> Self {
        Self(folder.to_owned())
    }

    /// The program of a node.
    ///
    /// # Errors
    /// [`LaunchError::NoProgram`].
    pub fn path(&self, node: Node) -> Result<PathBuf, LaunchError> {
        let path = self.0.join(node.name());
        if path.is_file() { Ok(path) } else { Err(LaunchError::NoProgram(path)) }
    }
}

/// ROS arguments of a node.
#[derive(Debug)]
pub(crate) struct Arguments(Vec<OsString>);

impl Default for Arguments {
    fn default() -> Self {
        Self(vec!["--ros-args".into()])
    }
}

impl Arguments {
    pub fn namespace(&mut self, platform: &str) {
        self.0.extend(["-r".into(), format!("__ns:=/{platform}").into()]);
    }

    pub fn file(&mut self, path: PathBuf) {
        self.0.extend(["--params-file".into(), path.into_os_string()]);
    }

    pub fn parameter(&mut self, key: &str, value: impl Display) {
        self.0.extend(["-p".into(), format!("{key}:={value}").into()]);
    }

    pub fn finish(self) -> Vec<OsString> {
        self.0
    }
}
