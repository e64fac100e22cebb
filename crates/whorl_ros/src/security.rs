//! SROS2's environment variables, and which keys they choose.
//!
//! <https://docs.ros.org/en/jazzy/Tutorials/Advanced/Security/Introducing-ros2-security.html>. Differences to `rcl`: a value
//! that it does not know is an error here instead of "no security", and a node without `--enclave` takes the enclave of its
//! own name instead of `/`.

use std::path::{Path, PathBuf};

use thiserror::Error;
use whorl_security::{ENCLAVE_FILES, Keystore, SecurityError};

/// Why a secured network cannot be joined. There is no fall-back under `ROS_SECURITY_STRATEGY=Enforce`.
#[derive(Debug, Error)]
pub enum SecurityRefusal {
    /// Not a value of ROS 2.
    #[error("{name}={value}: allowed: {allowed}")]
    Value {
        /// The variable.
        name: &'static str,
        /// What it is set to.
        value: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// Security was asked for, but no keystore was named.
    #[error("ROS_SECURITY_ENABLE=true, but ROS_SECURITY_KEYSTORE does not name a folder of keys")]
    NoKeystore,
    /// The enclave's folder is incomplete.
    #[error(
        "ROS_SECURITY_ENABLE=true, but enclave {enclave} has no {missing} in {}; \
         `whorl security check {}` says more",
        folder.display(), keystore.display()
    )]
    Incomplete {
        /// The enclave.
        enclave: String,
        /// The first file that is missing.
        missing: &'static str,
        /// Where it should be.
        folder: PathBuf,
        /// The keystore.
        keystore: PathBuf,
    },
    /// The keystore.
    #[error("ROS_SECURITY_ENABLE=true: {0}")]
    Keystore(#[from] SecurityError),
}

impl SecurityRefusal {
    /// Whether only the environment's values are wrong, which no strategy tolerates.
    fn is_misspelt(&self) -> bool {
        matches!(self, Self::Value { .. })
    }
}

/// What the environment asks for.
#[derive(Debug)]
pub(crate) enum Choice {
    /// No security.
    Open,
    /// No security, though it was asked for: the strategy permits that.
    Permitted(SecurityRefusal),
    /// The keys in this folder.
    Enclave(PathBuf),
}

/// Reads the variables; `enclave` is that of `--enclave`, or else the default.
pub(crate) fn choose(
    variable: impl Fn(&str) -> Option<String>,
    enclave: &str,
    is_built: bool,
) -> Result<Choice, SecurityRefusal> {
    let set = |name| variable(name).filter(|value| !value.is_empty());
    match set("ROS_SECURITY_ENABLE").as_deref() {
        None | Some("false") => return Ok(Choice::Open),
        Some("true") => {}
        Some(value) => {
            return Err(SecurityRefusal::Value {
                name: "ROS_SECURITY_ENABLE",
                value: value.to_owned(),
                allowed: "true, false",
            });
        }
    }
    let enforce = match set("ROS_SECURITY_STRATEGY").as_deref() {
        None | Some("Permissive") => false,
        Some("Enforce") => true,
        Some(value) => {
            return Err(SecurityRefusal::Value {
                name: "ROS_SECURITY_STRATEGY",
                value: value.to_owned(),
                allowed: "Enforce, Permissive",
            });
        }
    };
    let overriding = set("ROS_SECURITY_ENCLAVE_OVERRIDE");
    let enclave = overriding.as_deref().unwrap_or(enclave);
    match folder(set("ROS_SECURITY_KEYSTORE").as_deref(), enclave, is_built) {
        Ok(folder) => Ok(Choice::Enclave(folder)),
        Err(refusal) if enforce || refusal.is_misspelt() => Err(refusal),
        Err(refusal) => Ok(Choice::Permitted(refusal)),
    }
}

fn folder(keystore: Option<&str>, enclave: &str, is_built: bool) -> Result<PathBuf, SecurityRefusal> {
    let path = keystore.map(Path::new).ok_or(SecurityRefusal::NoKeystore)?;
    if !is_built {
        return Err(SecurityError::NotBuilt.into());
    }
    // A platform's computer has the enclaves of its nodes, and no more of the keystore than that.
    let folder = Keystore::at(path).enclave_folder(enclave)?;
    match ENCLAVE_FILES.iter().find(|file| !folder.join(file).is_file()) {
        None => Ok(folder),
        Some(missing) => Err(SecurityRefusal::Incomplete {
            enclave: enclave.to_owned(),
            missing,
            folder,
            keystore: path.to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(variables: &[(&str, &str)], is_built: bool) -> Result<Choice, SecurityRefusal> {
        let find = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned());
        choose(find, "/whorl_1/driver", is_built)
    }

    #[test]
    fn nothing_set_means_open() {
        assert!(matches!(with(&[], true), Ok(Choice::Open)));
        assert!(matches!(with(&[("ROS_SECURITY_ENABLE", "false")], true), Ok(Choice::Open)));
        assert!(matches!(with(&[("ROS_SECURITY_STRATEGY", "Enforce")], true), Ok(Choice::Open)));
    }

    #[test]
    fn a_misspelt_value_is_never_no_security() {
        let text = with(&[("ROS_SECURITY_ENABLE", "True")], true).unwrap_err().to_string();
        assert!(text.contains("allowed: true, false"), "{text}");
        let misspelt = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "enforce")];
        let text = with(&misspelt, true).unwrap_err().to_string();
        assert!(text.contains("allowed: Enforce, Permissive"), "{text}");
    }

    #[test]
    fn enforcing_refuses_what_permitting_reports() {
        let folder = tempfile::tempdir().unwrap();
        let store = folder.path().to_str().unwrap();
        let all = [
            ("ROS_SECURITY_ENABLE", "true"),
            ("ROS_SECURITY_KEYSTORE", store),
            ("ROS_SECURITY_STRATEGY", "Enforce"),
        ];
        // No keystore; nothing in it; programs that cannot.
        for (count, is_built, expected) in [
            (1, true, "ROS_SECURITY_KEYSTORE"),
            (2, true, "identity_ca.cert.pem"),
            (2, false, "--features security"),
        ] {
            let permitted = with(&all[..count], is_built);
            assert!(matches!(permitted, Ok(Choice::Permitted(_))), "{permitted:?}");
            let enforced: Vec<_> = all[..count].iter().chain(&all[2..]).copied().collect();
            let text = with(&enforced, is_built).unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
        let own = folder.path().join("enclaves/whorl_1/driver");
        std::fs::create_dir_all(&own).unwrap();
        ENCLAVE_FILES.iter().for_each(|file| std::fs::write(own.join(file), "").unwrap());
        assert!(matches!(with(&all, true), Ok(Choice::Enclave(found)) if found == own));
        let other = [&all[..], &[("ROS_SECURITY_ENCLAVE_OVERRIDE", "/recorder")]].concat();
        assert!(with(&other, true).unwrap_err().to_string().contains("enclave /recorder"));
    }
}
