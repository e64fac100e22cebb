//! Keys, certificates and signed documents, by OpenSSL: P-256, SHA-256, S/MIME with the text in the clear, as SROS2 does.

use openssl::asn1::{Asn1Integer, Asn1Time};
use openssl::bn::{BigNum, MsbOption};
use openssl::ec::{EcGroup, EcKey};
use openssl::error::ErrorStack;
use openssl::hash::MessageDigest;
use openssl::nid::Nid;
use openssl::pkcs7::{Pkcs7, Pkcs7Flags};
use openssl::pkey::{PKey, Private};
use openssl::stack::Stack;
use openssl::x509::extension::BasicConstraints;
use openssl::x509::store::X509StoreBuilder;
use openssl::x509::{X509, X509Builder, X509Name, X509NameBuilder};

/// SROS2's: from a day ago, as clocks differ.
pub(crate) const VALID_BEFORE_S: i64 = 86_400;
/// SROS2's: ten years.
pub(crate) const VALID_FOR_S: i64 = 3650 * 86_400;

/// A certificate and its private key.
pub(crate) struct Identity {
    pub(crate) certificate: X509,
    pub(crate) key: PKey<Private>,
}

impl Identity {
    /// A new certification authority of this name.
    pub(crate) fn authority(name: &str, now_s: i64) -> Result<Self, ErrorStack> {
        let key = new_key()?;
        let subject = common_name(name)?;
        let certificate = certificate(&subject, &key, &subject, &key, true, now_s)?;
        Ok(Self { certificate, key })
    }

    /// A new participant of this name, certified by this authority.
    pub(crate) fn issue(&self, name: &str, now_s: i64) -> Result<Self, ErrorStack> {
        let key = new_key()?;
        let issuer = self.certificate.subject_name().to_owned()?;
        let certificate = certificate(&common_name(name)?, &key, &issuer, &self.key, false, now_s)?;
        Ok(Self { certificate, key })
    }

    pub(crate) fn from_pem(certificate: &[u8], key: &[u8]) -> Result<Self, ErrorStack> {
        Ok(Self { certificate: X509::from_pem(certificate)?, key: PKey::private_key_from_pem(key)? })
    }

    /// A document with its signature (`multipart/signed`).
    pub(crate) fn sign(&self, document: &str) -> Result<Vec<u8>, ErrorStack> {
        let flags = Pkcs7Flags::DETACHED | Pkcs7Flags::TEXT;
        let none = Stack::new()?;
        let signed = Pkcs7::sign(&self.certificate, &self.key, &none, document.as_bytes(), flags)?;
        signed.to_smime(document.as_bytes(), flags)
    }
}

/// The document inside, if this authority has signed it.
pub(crate) fn verified(signed: &[u8], authority: &X509) -> Result<String, ErrorStack> {
    let (message, content) = Pkcs7::from_smime(signed)?;
    let mut store = X509StoreBuilder::new()?;
    store.add_cert(authority.clone())?;
    let store = store.build();
    let mut signers = Stack::new()?;
    signers.push(authority.clone())?;
    let mut document = Vec::new();
    // Only the authority is a signer, not a certificate that the message brings along, be it of the same name; and it is
    // trusted as it is: whether it may sign mail is not the question here.
    let flags = Pkcs7Flags::TEXT | Pkcs7Flags::NOINTERN | Pkcs7Flags::NOVERIFY;
    message.verify(&signers, &store, content.as_deref(), Some(&mut document), flags)?;
    Ok(String::from_utf8_lossy(&document).into_owned())
}

fn new_key() -> Result<PKey<Private>, ErrorStack> {
    let group = EcGroup::from_curve_name(Nid::X9_62_PRIME256V1)?;
    PKey::from_ec_key(EcKey::generate(&group)?)
}

fn common_name(name: &str) -> Result<X509Name, ErrorStack> {
    let mut builder = X509NameBuilder::new()?;
    builder.append_entry_by_nid(Nid::COMMONNAME, name)?;
    Ok(builder.build())
}

fn certificate(
    subject: &X509Name,
    key: &PKey<Private>,
    issuer: &X509Name,
    issuer_key: &PKey<Private>,
    is_authority: bool,
    now_s: i64,
) -> Result<X509, ErrorStack> {
    let mut builder = X509Builder::new()?;
    builder.set_version(2)?; // X.509 v3
    let mut serial = BigNum::new()?;
    serial.rand(159, MsbOption::MAYBE_ZERO, false)?;
    let serial: Asn1Integer = serial.to_asn1_integer()?;
    builder.set_serial_number(&serial)?;
    builder.set_subject_name(subject)?;
    builder.set_issuer_name(issuer)?;
    builder.set_pubkey(key)?;
    let (not_before, not_after) =
        (Asn1Time::from_unix(now_s - VALID_BEFORE_S)?, Asn1Time::from_unix(now_s + VALID_FOR_S)?);
    builder.set_not_before(&not_before)?;
    builder.set_not_after(&not_after)?;
    let mut constraints = BasicConstraints::new();
    if is_authority {
        constraints.critical().ca().pathlen(1);
    }
    builder.append_extension(constraints.build()?)?;
    builder.sign(issuer_key, MessageDigest::sha256())?;
    Ok(builder.build())
}
