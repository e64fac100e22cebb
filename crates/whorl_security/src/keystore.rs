//! The folder of keys, certificates and permissions, laid out as SROS2 does:
//!
//! ```text
//! public/   ca.cert.pem; identity_ca.cert.pem and permissions_ca.cert.pem are links to it
//! private/  ca.key.pem; identity_ca.key.pem and permissions_ca.key.pem are links to it. Stays on one computer.
//! enclaves/ governance.xml, governance.p7s, and a folder for each enclave:
//!   whorl_1/driver/  cert.pem key.pem permissions.xml permissions.p7s; links to governance.p7s and the public files
//! ```

use std::path::{Path, PathBuf};

use crate::error::SecurityError;

/// The files that a participant needs in the folder of its enclave.
pub const ENCLAVE_FILES: [&str; 6] = [
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
];

/// What makes a folder a keystore.
const KEYSTORE_FILES: [&str; 3] =
    ["public/identity_ca.cert.pem", "public/permissions_ca.cert.pem", "enclaves/governance.p7s"];

/// Something about a keystore that its owner should know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Which enclave; `/` for the keystore itself.
    pub enclave: String,
    /// What, in a sentence.
    pub text: String,
    /// Whether a participant is refused, or refuses to start, because of it.
    pub is_fatal: bool,
}

/// A keystore.
#[derive(Debug, Clone)]
pub struct Keystore {
    path: PathBuf,
}

impl Keystore {
    /// A keystore that is there.
    ///
    /// # Errors
    /// [`SecurityError::NoKeystore`].
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, SecurityError> {
        let path = path.into();
        match KEYSTORE_FILES.iter().find(|file| !path.join(file).is_file()) {
            Some(missing) => Err(SecurityError::NoKeystore { path, missing }),
            None => Ok(Self { path }),
        }
    }

    /// A folder that may hold no more of a keystore than some enclaves, as on a platform's computer.
    #[must_use]
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into() }
    }

    /// Its folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Folder of an enclave.
    ///
    /// # Errors
    /// [`SecurityError::Name`].
    pub fn enclave_folder(&self, enclave: &str) -> Result<PathBuf, SecurityError> {
        Ok(self.path.join("enclaves").join(relative(enclave)?))
    }

    /// Names of its enclaves, sorted.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn enclaves(&self) -> Result<Vec<String>, SecurityError> {
        let mut found = Vec::new();
        list(&self.path.join("enclaves"), "", &mut found)?;
        found.sort();
        Ok(found)
    }
}

/// `/whorl_1/driver` as a path below the folder of enclaves.
fn relative(enclave: &str) -> Result<PathBuf, SecurityError> {
    let error = || SecurityError::Name { name: enclave.to_owned() };
    let name = enclave.strip_prefix('/').ok_or_else(error)?;
    let is_token = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    // The root enclave `/` is a valid one in ROS 2: its files are in `enclaves` itself.
    if name.is_empty() || name.split('/').all(is_token) { Ok(PathBuf::from(name)) } else { Err(error()) }
}

fn list(folder: &Path, name: &str, found: &mut Vec<String>) -> Result<(), SecurityError> {
    if folder.join("key.pem").is_file() {
        found.push(if name.is_empty() { "/".to_owned() } else { name.to_owned() });
    }
    for entry in std::fs::read_dir(folder).map_err(SecurityError::io(folder))? {
        let entry = entry.map_err(SecurityError::io(folder))?;
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            list(&entry.path(), &format!("{name}/{}", entry.file_name().to_string_lossy()), found)?;
        }
    }
    Ok(())
}

#[cfg(not(feature = "security"))]
mod making {
    use super::{Finding, Keystore};
    use crate::error::SecurityError;
    use crate::policy::Grant;
    use std::path::PathBuf;

    impl Keystore {
        /// Needs the feature `security`.
        ///
        /// # Errors
        /// [`SecurityError::NotBuilt`].
        pub fn create(_: impl Into<PathBuf>, _: u16, _: i64) -> Result<Self, SecurityError> {
            Err(SecurityError::NotBuilt)
        }

        /// Needs the feature `security`.
        ///
        /// # Errors
        /// [`SecurityError::NotBuilt`].
        pub fn add(&self, _: &Grant, _: u16, _: i64) -> Result<(), SecurityError> {
            Err(SecurityError::NotBuilt)
        }

        /// Needs the feature `security`.
        ///
        /// # Errors
        /// [`SecurityError::NotBuilt`].
        pub fn check(&self, _: u16, _: i64) -> Result<Vec<Finding>, SecurityError> {
            Err(SecurityError::NotBuilt)
        }
    }
}

#[cfg(feature = "security")]
mod checking;
#[cfg(feature = "security")]
mod making;
#[cfg(all(test, feature = "security"))]
mod trials;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_enclaves_cannot_leave_the_keystore() {
        for bad in ["", "driver", "/../etc", "/a//b", "/a/", "/1a", "/a b", "/a/./b"] {
            assert!(matches!(relative(bad), Err(SecurityError::Name { .. })), "{bad:?}");
        }
        assert_eq!(relative("/whorl_1/driver").unwrap(), Path::new("whorl_1/driver"));
        assert_eq!(relative("/").unwrap(), Path::new(""));
    }

    #[test]
    fn a_folder_without_the_files_is_named_and_the_command_that_makes_one() {
        let folder = tempfile::tempdir().unwrap();
        let text = Keystore::open(folder.path()).unwrap_err().to_string();
        assert!(
            text.contains("public/identity_ca.cert.pem") && text.contains("whorl security create"),
            "{text}"
        );
    }
}
