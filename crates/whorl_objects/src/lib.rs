//! Recordings and results in object storage, by paths of the form `s3://bucket/prefix`: Amazon S3, and every server that
//! speaks its protocol.
//!
//! Which server, and who asks, is what AWS's own programs read from the environment: `AWS_ACCESS_KEY_ID`,
//! `AWS_SECRET_ACCESS_KEY`, `AWS_SESSION_TOKEN`, `AWS_REGION`, `AWS_ENDPOINT_URL` (a server other than Amazon's), or the role of
//! the machine. A write is whole or not at all. All calls block.
//!
//! No other crate knows the protocol (`object_store`); without the feature `s3`, [`Place::open`] refuses.

mod local;
#[cfg(feature = "s3")]
mod store;
#[cfg(not(feature = "s3"))]
#[path = "without.rs"]
mod store;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use thiserror::Error;

pub use local::{Local, local};
pub use store::Place;

/// How paths in object storage begin.
const SCHEME: &str = "s3://";

/// Why something in object storage could not be read or written.
#[derive(Debug, Error)]
pub enum ObjectError {
    /// A path of another form.
    #[error("{0}: allowed: s3://BUCKET or s3://BUCKET/PREFIX")]
    Address(String),
    /// The program was built without it.
    #[error("{0}: this program was built without object storage; build it with `--features object_storage`")]
    NotBuilt(String),
    /// There is nothing.
    #[error("{0}: there is nothing with this name or below it")]
    Nothing(String),
    /// The server refused, or did not answer.
    #[error("cannot {action} {address}: {reason}")]
    Refused {
        /// What was tried.
        action: &'static str,
        /// On what.
        address: String,
        /// What the server or the connection said.
        reason: String,
    },
    /// A local file.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
}

impl ObjectError {
    /// For `map_err`.
    fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }
}

impl From<ObjectError> for std::io::Error {
    fn from(error: ObjectError) -> Self {
        Self::other(error)
    }
}

/// Whether a path is in object storage.
#[must_use]
pub fn is_remote(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().starts_with(SCHEME.as_bytes())
}

/// `path` as seen from `base`, either of which may be in object storage.
#[must_use]
pub fn join(base: &Path, path: &str) -> PathBuf {
    if is_remote(Path::new(path)) { PathBuf::from(path) } else { base.join(path) }
}

/// Bucket and prefix of an address; the prefix has no slash at either end.
fn parts(address: &str) -> Result<(&str, &str), ObjectError> {
    let wrong = || ObjectError::Address(address.to_owned());
    let rest = address.strip_prefix(SCHEME).ok_or_else(wrong)?;
    let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
    let prefix = prefix.trim_matches('/');
    let is_name = |part: &str| !part.is_empty() && part != "." && part != "..";
    if !is_name(bucket) || !(prefix.is_empty() || prefix.split('/').all(is_name)) {
        return Err(wrong());
    }
    Ok((bucket, prefix))
}
