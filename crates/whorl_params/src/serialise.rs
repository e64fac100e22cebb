//! The parameters in force, back to YAML.

use std::fmt::Write as _;

use crate::descriptor::Descriptor;
use crate::node_parameters::NodeParameters;
use crate::value::Value;

/// A ROS 2 parameter file with the parameters in force of some nodes, as a record of a run. It
/// loads again to the same values; each line names what the parameter means.
#[must_use]
pub fn effective_yaml<'a>(nodes: impl IntoIterator<Item = (&'a str, &'a [Descriptor])>) -> String {
    let mut text = String::new();
    for (node, descriptors) in nodes {
        let entries = descriptors
            .iter()
            .filter_map(|d| d.value.as_ref().map(|value| (d.name.as_str(), value, Some(d.doc.as_str()))));
        section(&mut text, node, entries);
    }
    text
}

impl NodeParameters {
    /// The layered, not yet validated, parameters of this node as a ROS 2 parameter file.
    #[must_use]
    pub fn to_yaml(&self) -> String {
        let mut text = String::new();
        section(&mut text, self.node(), self.iter().map(|entry| (entry.key.as_str(), &entry.value, None)));
        text
    }
}

fn section<'a>(
    text: &mut String,
    node: &str,
    entries: impl Iterator<Item = (&'a str, &'a Value, Option<&'a str>)>,
) {
    // Dotted keys on purpose: one line, one value, easy to compare between runs.
    let mut lines = String::new();
    for (key, value, doc) in entries {
        let comment = doc.map(|doc| format!("  # {}", doc.replace(['\n', '\r'], " "))).unwrap_or_default();
        // Writing to a String cannot fail.
        let _ = writeln!(lines, "    {key}: {value}{comment}");
    }
    let empty = if lines.is_empty() { " {}" } else { "" };
    let _ = write!(text, "{node}:\n  ros__parameters:{empty}\n{lines}");
}
