//! Says why a participant would be refused before it is.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use chrono::{DateTime, NaiveDateTime};
use openssl::asn1::Asn1Time;
use openssl::nid::Nid;
use openssl::pkey::PKey;
use openssl::x509::X509;
use roxmltree::{Document, Node};

use super::making::crypto;
use super::{ENCLAVE_FILES, Finding, Keystore};
use crate::error::SecurityError;
use crate::signing;

/// A certificate that ends within this time is worth a word.
const SOON_S: i64 = 30 * 86_400;

impl Keystore {
    /// Checks signatures, names, dates and domain of every enclave. `now_s` in seconds since 1970.
    ///
    /// # Errors
    /// When the keystore itself cannot be read.
    pub fn check(&self, domain: u16, now_s: i64) -> Result<Vec<Finding>, SecurityError> {
        let mut findings = Vec::new();
        let authority = |name: &str| certificate(&self.path.join(format!("public/{name}.cert.pem")));
        let (identities, permissions) = (authority("identity_ca")?, authority("permissions_ca")?);
        let governance = self.path.join("enclaves/governance.p7s");
        let mut say = |enclave: &str, text: String, is_fatal: bool| {
            findings.push(Finding { enclave: enclave.to_owned(), text, is_fatal });
        };
        match signed(&governance, &permissions) {
            Err(text) => say("/", text, true),
            Ok(text) => governed(&text, domain, &mut |text, is_fatal| say("/", text, is_fatal)),
        }
        for enclave in self.enclaves()? {
            let folder = self.enclave_folder(&enclave)?;
            let mut say = |text: String, is_fatal: bool| say(&enclave, text, is_fatal);
            if let Some(missing) = ENCLAVE_FILES.iter().find(|file| !folder.join(file).is_file()) {
                say(format!("{missing} is not there"), true);
                continue;
            }
            identified(&folder, &enclave, &identities, now_s, &mut say);
            match signed(&folder.join("permissions.p7s"), &permissions) {
                Err(text) => say(text, true),
                Ok(text) => permitted(&text, &enclave, domain, now_s, &mut say),
            }
        }
        Ok(findings)
    }
}

type Say<'a> = &'a mut dyn FnMut(String, bool);

fn certificate(path: &Path) -> Result<X509, SecurityError> {
    let pem = std::fs::read(path).map_err(SecurityError::io(path))?;
    X509::from_pem(&pem).map_err(crypto(path))
}

fn signed(path: &Path, authority: &X509) -> Result<String, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    signing::verified(&bytes, authority)
        .map_err(|_| format!("{} is not signed by public/permissions_ca.cert.pem", path.display()))
}

fn governed(text: &str, domain: u16, say: Say<'_>) {
    let Ok(document) = Document::parse(body(text)) else {
        return say("governance.p7s holds no XML".to_owned(), true);
    };
    if !has_domain(document.root(), domain) {
        say(
            format!(
                "governance.p7s is not for domain {domain} (ROS_DOMAIN_ID): {}",
                domains(document.root())
            ),
            true,
        );
    }
    if texts(document.root(), "allow_unauthenticated_participants")
        .any(|text| text.eq_ignore_ascii_case("true"))
    {
        say("governance.p7s lets participants without a certificate take part".to_owned(), false);
    }
}

fn identified(folder: &Path, enclave: &str, authority: &X509, now_s: i64, say: Say<'_>) {
    let own = match certificate(&folder.join("cert.pem")) {
        Ok(own) => own,
        Err(error) => return say(error.to_string(), true),
    };
    let signed = authority.public_key().and_then(|key| own.verify(&key)).unwrap_or(false);
    if !signed {
        say("cert.pem is not signed by public/identity_ca.cert.pem: another authority's".to_owned(), true);
    }
    let name = own.subject_name().entries_by_nid(Nid::COMMONNAME).next();
    let name = name.and_then(|entry| entry.data().to_string().ok());
    if name.as_deref() != Some(enclave) {
        say(format!("cert.pem is that of {}", name.unwrap_or_else(|| "nobody".to_owned())), true);
    }
    let at = |seconds| Asn1Time::from_unix(seconds);
    if at(now_s).is_ok_and(|now| *own.not_after() < *now || *own.not_before() > *now) {
        let (from, until) = (own.not_before(), own.not_after());
        say(format!("cert.pem is valid from {from} to {until}, not now: is the clock right?"), true);
    } else if at(now_s + SOON_S).is_ok_and(|soon| *own.not_after() < *soon) {
        say(format!("cert.pem is valid until {} only", own.not_after()), false);
    }
    let path = folder.join("key.pem");
    let key = std::fs::read(&path).ok().and_then(|pem| PKey::private_key_from_pem(&pem).ok());
    match key {
        None => say("key.pem is no private key without a password".to_owned(), true),
        Some(key) if !own.public_key().is_ok_and(|public| public.public_eq(&key)) => {
            say("key.pem does not belong to cert.pem".to_owned(), true);
        }
        Some(_) => {}
    }
    if std::fs::metadata(&path).is_ok_and(|file| file.permissions().mode() & 0o077 != 0) {
        say("key.pem can be read by other users of this computer: chmod 600".to_owned(), false);
    }
}

fn permitted(text: &str, enclave: &str, domain: u16, now_s: i64, say: Say<'_>) {
    let Ok(document) = Document::parse(body(text)) else {
        return say("permissions.p7s holds no XML".to_owned(), true);
    };
    let subject = format!("CN={enclave}");
    let mut grants = document.descendants().filter(|node| node.has_tag_name("grant"));
    let Some(grant) = grants.find(|grant| texts(*grant, "subject_name").any(|text| text == subject)) else {
        return say(format!("permissions.p7s grants nothing to {subject}"), true);
    };
    if !has_domain(grant, domain) {
        say(format!("permissions.p7s is not for domain {domain} (ROS_DOMAIN_ID): {}", domains(grant)), true);
    }
    let limit = |tag| texts(grant, tag).next().and_then(seconds);
    match (limit("not_before"), limit("not_after")) {
        (Some(from), Some(until)) if (from..until).contains(&now_s) => {}
        (Some(_), Some(_)) => say("permissions.p7s is not valid now: is the clock right?".to_owned(), true),
        _ => say("permissions.p7s has no dates of validity".to_owned(), true),
    }
    let publishes = grant.descendants().filter(|node| node.has_tag_name("publish"));
    if publishes.flat_map(|node| texts(node, "topic")).any(|topic| topic.contains('*')) {
        say("it may write topics by a pattern (`*`), actuator commands among them".to_owned(), false);
    }
}

/// The document itself, after the MIME header of some signers.
fn body(text: &str) -> &str {
    text.find('<').map_or(text, |start| &text[start..])
}

fn texts<'a>(node: Node<'a, '_>, tag: &'static str) -> impl Iterator<Item = &'a str> {
    node.descendants()
        .filter(move |node| node.has_tag_name(tag))
        .filter_map(|node| node.text())
        .map(str::trim)
}

fn has_domain(node: Node<'_, '_>, domain: u16) -> bool {
    let number = |text: &str| text.parse::<u16>().ok();
    let named = node
        .descendants()
        .filter(|node| {
            node.has_tag_name("id") && node.parent().is_some_and(|parent| parent.has_tag_name("domains"))
        })
        .any(|node| node.text().map(str::trim).and_then(number) == Some(domain));
    let mut ranges = node.descendants().filter(|node| node.has_tag_name("id_range"));
    named
        || ranges.any(|range| {
            let bound = |tag| texts(range, tag).next().and_then(number);
            bound("min").is_none_or(|min| min <= domain) && bound("max").is_none_or(|max| domain <= max)
        })
}

fn domains(node: Node<'_, '_>) -> String {
    let ids: Vec<&str> = texts(node, "id").collect();
    format!("it is for {}", if ids.is_empty() { "a range".to_owned() } else { ids.join(", ") })
}

fn seconds(text: &str) -> Option<i64> {
    DateTime::parse_from_rfc3339(text)
        .map(|time| time.timestamp())
        .or_else(|_| {
            NaiveDateTime::parse_from_str(text, "%Y-%m-%dT%H:%M:%S").map(|time| time.and_utc().timestamp())
        })
        .ok()
}
