//! Keystores that are right, and in each way wrong; signatures judged by the `openssl` command.

use std::os::unix::fs::PermissionsExt as _;
use std::process::Command;

use super::{Finding, Keystore};
use crate::policy::grants;

const NOW_S: i64 = 1_800_000_000;
const YEAR_S: i64 = 365 * 86_400;

#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
fn keystore(folder: &std::path::Path, domain: u16) -> Keystore {
    let keystore = Keystore::create(folder, domain, NOW_S).unwrap();
    for grant in grants(&["whorl_1"]) {
        keystore.add(&grant, domain, NOW_S).unwrap();
    }
    keystore
}

fn fatal(findings: &[Finding], enclave: &str) -> Vec<String> {
    let of = findings.iter().filter(|finding| finding.is_fatal && finding.enclave == enclave);
    of.map(|finding| finding.text.clone()).collect()
}

#[test]
fn a_new_keystore_is_right_and_openssl_agrees() {
    let folder = tempfile::tempdir().unwrap();
    let keystore = keystore(folder.path(), 7);
    assert_eq!(keystore.check(7, NOW_S).unwrap(), []);
    let enclaves = keystore.enclaves().unwrap();
    assert_eq!(enclaves.len(), 9, "{enclaves:?}");
    let driver = keystore.enclave_folder("/whorl_1/driver").unwrap();
    let openssl = |arguments: &[&str]| {
        let output = Command::new("openssl").args(arguments).current_dir(&driver).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let at = NOW_S.to_string();
    openssl(&["verify", "-attime", &at, "-CAfile", "identity_ca.cert.pem", "cert.pem"]);
    for document in ["governance.p7s", "permissions.p7s"] {
        let ca = "permissions_ca.cert.pem";
        let text = openssl(&["smime", "-verify", "-text", "-attime", &at, "-CAfile", ca, "-in", document]);
        roxmltree::Document::parse(&text).unwrap();
    }
    let key = std::fs::metadata(driver.join("key.pem")).unwrap();
    assert_eq!(key.permissions().mode() & 0o777, 0o600);
    // Once more: keys stay, permissions are renewed.
    let before = std::fs::read(driver.join("cert.pem")).unwrap();
    self::keystore(folder.path(), 7);
    assert_eq!(std::fs::read(driver.join("cert.pem")).unwrap(), before);
}

#[test]
fn what_is_wrong_is_named_for_the_enclave_that_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let (own, other) = (keystore(&folder.path().join("own"), 7), keystore(&folder.path().join("other"), 7));
    let driver = own.enclave_folder("/whorl_1/driver").unwrap();
    let estimator = own.enclave_folder("/whorl_1/estimator").unwrap();
    let foreign = other.enclave_folder("/whorl_1/driver").unwrap();
    let found = |words: &str| {
        let findings = own.check(7, NOW_S).unwrap();
        let texts = fatal(&findings, "/whorl_1/driver");
        assert!(texts.iter().any(|text| text.contains(words)), "{words}: {texts:?}");
        assert_eq!(fatal(&findings, "/whorl_1/estimator"), [""; 0]);
    };
    let put = |name: &str, bytes: Vec<u8>| std::fs::write(driver.join(name), bytes).unwrap();
    let read = |name: &str| std::fs::read(driver.join(name)).unwrap();
    let (certificate, key, permissions) = (read("cert.pem"), read("key.pem"), read("permissions.p7s"));

    put("cert.pem", std::fs::read(foreign.join("cert.pem")).unwrap());
    found("another authority's");
    put("cert.pem", std::fs::read(estimator.join("cert.pem")).unwrap());
    found("that of /whorl_1/estimator");
    put("cert.pem", certificate);
    put("key.pem", std::fs::read(estimator.join("key.pem")).unwrap());
    found("does not belong to cert.pem");
    put("key.pem", key);
    put("permissions.p7s", std::fs::read(foreign.join("permissions.p7s")).unwrap());
    found("is not signed by");
    put("permissions.p7s", std::fs::read(estimator.join("permissions.p7s")).unwrap());
    found("grants nothing to CN=/whorl_1/driver");
    let text = String::from_utf8(permissions.clone()).unwrap();
    put("permissions.p7s", text.replacen("rt/whorl_1/battery", "rt/whorl_2/battery", 1).into_bytes());
    found("is not signed by");
    put("permissions.p7s", permissions);
    assert_eq!(own.check(7, NOW_S).unwrap(), []);

    let elsewhere = own.check(8, NOW_S).unwrap();
    assert!(fatal(&elsewhere, "/")[0].contains("not for domain 8"), "{elsewhere:?}");
    for (now_s, words) in [(NOW_S + 11 * YEAR_S, "not now"), (NOW_S - 2 * 86_400, "not now")] {
        let texts = fatal(&own.check(7, now_s).unwrap(), "/whorl_1/driver").join("; ");
        assert!(texts.contains(words) && texts.contains("not valid now"), "{texts}");
    }
    let soon = own.check(7, NOW_S + 10 * YEAR_S - 86_400).unwrap();
    assert!(soon.iter().all(|finding| !finding.is_fatal) && soon[0].text.contains("valid until"), "{soon:?}");
}
