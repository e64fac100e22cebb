//! What can go wrong with a keystore.

use std::path::PathBuf;

use thiserror::Error;

/// What can go wrong with a keystore.
#[derive(Debug, Error)]
pub enum SecurityError {
    /// The programs were built without the feature.
    #[error(
        "these programs were built without security: build with `cargo build --release --workspace --bins \
         --features security` (needs OpenSSL's headers; Debian: libssl-dev and pkg-config)"
    )]
    NotBuilt,
    /// A folder without the files of a keystore.
    #[error(
        "{} is no keystore: {missing} is not there; `whorl security create {}` makes one",
        path.display(), path.display()
    )]
    NoKeystore {
        /// The folder.
        path: PathBuf,
        /// The first file that is missing, relative to it.
        missing: &'static str,
    },
    /// Not a name of an enclave.
    #[error(
        "`{name}` is no name of an enclave: allowed are names such as /whorl_1/driver, of letters, digits and \
         underscores between slashes, none beginning with a digit"
    )]
    Name {
        /// What was given.
        name: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A key, certificate or signature that OpenSSL refuses.
    #[error("{}: {reason}", path.display())]
    Crypto {
        /// Which file.
        path: PathBuf,
        /// What OpenSSL says.
        reason: String,
    },
}

impl SecurityError {
    pub(crate) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, source }
    }
}
