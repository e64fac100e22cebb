//! Makes keystores and enclaves.

use std::fs::{DirBuilder, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, symlink};
use std::path::{Path, PathBuf};

use openssl::error::ErrorStack;

use super::Keystore;
use crate::documents;
use crate::error::SecurityError;
use crate::policy::Grant;
use crate::signing::{Identity, VALID_BEFORE_S, VALID_FOR_S};

/// SROS2's name of the authority.
const AUTHORITY: &str = "sros2CA";

impl Keystore {
    /// Makes a keystore for a domain with an authority of its own; keeps what is there already. `now_s` is the time in
    /// seconds since 1970, from which certificates are valid.
    ///
    /// # Errors
    /// When files cannot be written, or what is there is damaged.
    pub fn create(path: impl Into<PathBuf>, domain: u16, now_s: i64) -> Result<Self, SecurityError> {
        let path = path.into();
        let (public, private, enclaves) = (path.join("public"), path.join("private"), path.join("enclaves"));
        for folder in [&public, &private, &enclaves] {
            make_folder(folder)?;
        }
        let there = |name: &str| {
            public.join(format!("{name}.cert.pem")).is_file()
                && private.join(format!("{name}.key.pem")).is_file()
        };
        if !(there("identity_ca") && there("permissions_ca")) {
            let (certificate, key) = (public.join("ca.cert.pem"), private.join("ca.key.pem"));
            let authority = Identity::authority(AUTHORITY, now_s).map_err(crypto(&certificate))?;
            authority.write(&certificate, &key)?;
            for name in ["identity_ca", "permissions_ca"] {
                link("ca.cert.pem", &public.join(format!("{name}.cert.pem")))?;
                link("ca.key.pem", &private.join(format!("{name}.key.pem")))?;
            }
        }
        let keystore = Self { path };
        if !enclaves.join("governance.p7s").is_file() {
            keystore.write_signed(&enclaves.join("governance"), &documents::governance(domain))?;
        }
        Ok(keystore)
    }

    /// Makes an enclave, or renews the permissions of one: its key and certificate stay.
    ///
    /// # Errors
    /// When files cannot be written, or the keys of the authorities are not there.
    pub fn add(&self, grant: &Grant, domain: u16, now_s: i64) -> Result<(), SecurityError> {
        let folder = self.enclave_folder(&grant.enclave)?;
        make_folder(&folder)?;
        let up = "../".repeat(grant.enclave.split('/').filter(|part| !part.is_empty()).count());
        for name in ["identity_ca.cert.pem", "permissions_ca.cert.pem"] {
            link(&format!("{up}../public/{name}"), &folder.join(name))?;
        }
        link(&format!("{up}governance.p7s"), &folder.join("governance.p7s"))?;
        let (certificate, key) = (folder.join("cert.pem"), folder.join("key.pem"));
        if !(certificate.is_file() && key.is_file()) {
            let authority = self.authority("identity_ca")?;
            let identity = authority.issue(&grant.enclave, now_s).map_err(crypto(&certificate))?;
            identity.write(&certificate, &key)?;
        }
        let text = documents::permissions(grant, domain, now_s - VALID_BEFORE_S, now_s + VALID_FOR_S);
        self.write_signed(&folder.join("permissions"), &text)
    }

    fn authority(&self, name: &str) -> Result<Identity, SecurityError> {
        let certificate = self.path.join(format!("public/{name}.cert.pem"));
        let key = self.path.join(format!("private/{name}.key.pem"));
        let read = |path: &Path| std::fs::read(path).map_err(SecurityError::io(path));
        Identity::from_pem(&read(&certificate)?, &read(&key)?).map_err(crypto(&key))
    }

    /// Writes `STEM.xml` and, signed, `STEM.p7s`.
    fn write_signed(&self, stem: &Path, text: &str) -> Result<(), SecurityError> {
        let signed = stem.with_extension("p7s");
        let bytes = self.authority("permissions_ca")?.sign(text).map_err(crypto(&signed))?;
        write(&stem.with_extension("xml"), text.as_bytes(), 0o644)?;
        write(&signed, &bytes, 0o644)
    }
}

impl Identity {
    fn write(&self, certificate: &Path, key: &Path) -> Result<(), SecurityError> {
        let pem = self.key.private_key_to_pem_pkcs8().map_err(crypto(key))?;
        write(key, &pem, 0o600)?;
        let pem = self.certificate.to_pem().map_err(crypto(certificate))?;
        write(certificate, &pem, 0o644)
    }
}

pub(super) fn crypto(path: &Path) -> impl FnOnce(ErrorStack) -> SecurityError {
    let path = path.to_owned();
    move |error| {
        let reasons: Vec<&str> = error.errors().iter().filter_map(|e| e.reason()).collect();
        let reason = if reasons.is_empty() { "refused by OpenSSL".to_owned() } else { reasons.join(", ") };
        SecurityError::Crypto { path, reason }
    }
}

/// Only for the user: private keys are below.
fn make_folder(path: &Path) -> Result<(), SecurityError> {
    DirBuilder::new().recursive(true).mode(0o700).create(path).map_err(SecurityError::io(path))
}

/// Writes beside it first, so that nobody reads half a file.
fn write(path: &Path, bytes: &[u8], mode: u32) -> Result<(), SecurityError> {
    let beside = path.with_extension("new");
    let _ = std::fs::remove_file(&beside);
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(&beside)
        .map_err(SecurityError::io(&beside))?;
    file.write_all(bytes).map_err(SecurityError::io(&beside))?;
    std::fs::rename(&beside, path).map_err(SecurityError::io(path))
}

fn link(target: &str, path: &Path) -> Result<(), SecurityError> {
    if path.exists() {
        return Ok(());
    }
    // A link that leads nowhere.
    let _ = std::fs::remove_file(path);
    symlink(target, path).map_err(SecurityError::io(path))
}
