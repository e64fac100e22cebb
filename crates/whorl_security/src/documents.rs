//! The two documents that a certification authority signs, as SROS2 writes them.
//!
//! Formats: OMG DDS Security 1.1, 9.4.1.2 (governance) and 9.4.1.3 (permissions).

use chrono::DateTime;

use crate::policy::Grant;

/// Names in a document are those of ROS, or this.
const SCHEMAS: &str = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca";

/// Rules of the domain, those that SROS2 chooses: nobody without a certificate takes part, all data and all discovery is
/// encrypted, every datagram is signed, and topics are read and written by permission only.
#[must_use]
pub fn governance(domain: u16) -> String {
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:noNamespaceSchemaLocation="{SCHEMAS}_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains>
        <id>{domain}</id>
      </domains>
      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
      <enable_join_access_control>true</enable_join_access_control>
      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
      <rtps_protection_kind>SIGN</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>ENCRYPT</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
"#
    )
}

/// What one enclave may do in a domain, between two times [s since 1970, UTC].
#[must_use]
pub fn permissions(grant: &Grant, domain: u16, not_before_s: i64, not_after_s: i64) -> String {
    let list = |action: &str, topics: &std::collections::BTreeSet<String>| {
        if topics.is_empty() {
            return String::new();
        }
        let lines: String = topics.iter().map(|t| format!("            <topic>{t}</topic>\n")).collect();
        format!("        <{action}>\n          <topics>\n{lines}          </topics>\n        </{action}>\n")
    };
    let (publish, subscribe) = (list("publish", &grant.publish), list("subscribe", &grant.subscribe));
    let (from, until) = (utc(not_before_s), utc(not_after_s));
    let name = &grant.enclave;
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:noNamespaceSchemaLocation="{SCHEMAS}_permissions.xsd">
  <permissions>
    <grant name="{name}">
      <subject_name>CN={name}</subject_name>
      <validity>
        <not_before>{from}</not_before>
        <not_after>{until}</not_after>
      </validity>
      <allow_rule>
        <domains>
          <id>{domain}</id>
        </domains>
{publish}{subscribe}      </allow_rule>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"#
    )
}

fn utc(seconds: i64) -> String {
    DateTime::from_timestamp(seconds, 0).unwrap_or_default().format("%Y-%m-%dT%H:%M:%S").to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documents_are_well_formed_and_say_what_was_granted() {
        let grant = Grant {
            enclave: "/whorl_1/driver".into(),
            publish: ["rt/a".to_owned(), "rt/b".to_owned()].into(),
            subscribe: [].into(),
        };
        let text = permissions(&grant, 7, 0, 86_400 * 366);
        let document = roxmltree::Document::parse(&text).unwrap();
        let texts = |tag: &str| -> Vec<String> {
            let nodes = document.descendants().filter(|n| n.has_tag_name(tag));
            nodes.filter_map(|n| n.text()).map(str::to_owned).collect()
        };
        assert_eq!(texts("topic"), ["rt/a", "rt/b"]);
        assert_eq!(texts("id"), ["7"]);
        assert_eq!(texts("subject_name"), ["CN=/whorl_1/driver"]);
        // 1970 has 365 days.
        assert_eq!(texts("not_after"), ["1971-01-02T00:00:00"]);
        assert_eq!(texts("default"), ["DENY"]);
        assert!(!text.contains("<subscribe>"));
        roxmltree::Document::parse(&governance(7)).unwrap();
    }
}
