//! Copies of recordings on this machine, for as long as they are read.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::{ObjectError, Place, is_remote};

/// A file or folder on this machine: that of a path, or a copy of what is in object storage, which goes with this value.
#[derive(Debug)]
pub struct Local {
    given: PathBuf,
    path: PathBuf,
    _copies: Option<TempDir>,
}

impl Local {
    /// The path itself, without a look at it.
    #[must_use]
    pub fn as_given(path: &Path) -> Self {
        Self { given: path.to_owned(), path: path.to_owned(), _copies: None }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// A text that may name the copy, such as an error, with the path that was given in its place.
    #[must_use]
    pub fn told(&self, text: &str) -> String {
        text.replace(&*self.path.to_string_lossy(), &self.given.to_string_lossy())
    }
}

/// The file or folder of a path. What is in object storage is copied, under its own name, into a temporary folder.
///
/// # Errors
/// An invalid address; nothing there; a server that refuses; a full disk.
pub fn local(path: &Path) -> Result<Local, ObjectError> {
    if !is_remote(path) {
        return Ok(Local::as_given(path));
    }
    let place = Place::open(path)?;
    let copies = tempfile::Builder::new()
        .prefix("whorl-objects-")
        .tempdir()
        .map_err(ObjectError::io("create a folder in", &std::env::temp_dir()))?;
    let name = place.address().rsplit('/').next().unwrap_or_default();
    let copy = copies.path().join(name);
    place.fetch(&copy)?;
    Ok(Local { given: path.to_owned(), path: copy, _copies: Some(copies) })
}
