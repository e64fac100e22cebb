//! Every parameter of a node, whatever is set: found by reading again and again with other choices.
//!
//! What a node reads depends on what it has read: a law has settings of its own, a backend as well. From some files to begin
//! with, each word of every choice, and both values of every truth value, are tried, one change at a time on top of the
//! answers that led there, until nothing new is asked.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::descriptor::Descriptor;
use crate::node_parameters::NodeParameters;
use crate::reader::Reader;
use crate::value::{Kind, Value};

/// One parameter, or all that differ in a name only that the user gives.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedParameter {
    /// Full key with dots; `<name>` and `<platform>` stand for the user's names.
    pub key: String,
    /// Its type.
    pub kind: Kind,
    /// What is in force when nothing is given.
    pub default: ListedDefault,
    /// What is allowed, in words.
    pub allowed: String,
    /// What it means, with its unit.
    pub doc: String,
    /// True when it can only be set at the start of the node.
    pub read_only: bool,
}

/// What is in force when nothing is given.
#[derive(Debug, Clone, PartialEq)]
pub enum ListedDefault {
    /// A value must be given.
    Required,
    /// It may be left out.
    None,
    /// This.
    Value(Value),
    /// It follows from other parameters.
    Depends,
}

/// What `read` asks for, in the order of keys, with at first what each of `bases` gives. `platforms` are the names that become
/// `<platform>`.
pub fn list_parameters(
    bases: &[NodeParameters],
    platforms: &[String],
    mut read: impl FnMut(&mut Reader<'_>),
) -> Vec<ListedParameter> {
    let mut found: BTreeMap<(String, String, String), ListedParameter> = BTreeMap::new();
    let mut tried: BTreeSet<(String, String)> = BTreeSet::new();
    let mut queue: VecDeque<NodeParameters> = bases.iter().cloned().collect();
    while let Some(parameters) = queue.pop_front() {
        let mut reader = Reader::new(&parameters);
        read(&mut reader);
        let (asked, named) = reader.into_asked();
        for descriptor in &asked {
            let key = general(&descriptor.name, &named, platforms);
            for value in alternatives(descriptor) {
                if tried.insert((key.clone(), value.to_string())) && descriptor.value.as_ref() != Some(&value)
                {
                    queue.push_back(parameters.with(&descriptor.name, value));
                }
            }
            let default = match (&descriptor.default, descriptor.required) {
                (Some(value), _) => ListedDefault::Value(value.clone()),
                (None, true) => ListedDefault::Required,
                (None, false) => ListedDefault::None,
            };
            let listed = ListedParameter {
                key: key.clone(),
                kind: descriptor.kind,
                default,
                allowed: descriptor.allowed.clone(),
                doc: descriptor.doc.clone(),
                read_only: descriptor.read_only,
            };
            let place = (key, descriptor.doc.clone(), descriptor.allowed.clone());
            let present = found.entry(place).or_insert_with(|| listed.clone());
            if present.default != listed.default {
                present.default = ListedDefault::Depends;
            }
        }
    }
    found.into_values().collect()
}

/// The other answers to a question that has few.
fn alternatives(descriptor: &Descriptor) -> Vec<Value> {
    match descriptor.kind {
        Kind::Bool => vec![Value::Bool(false), Value::Bool(true)],
        _ => descriptor.choices.iter().map(|choice| Value::String(choice.clone())).collect(),
    }
}

/// The key with `<platform>` and `<name>` for what the user names.
fn general(key: &str, named: &BTreeSet<String>, platforms: &[String]) -> String {
    let mut parts: Vec<&str> = Vec::new();
    let mut so_far = String::new();
    for part in key.split('.') {
        let shown = if platforms.iter().any(|platform| platform == part) {
            "<platform>"
        } else if named.contains(&so_far) {
            "<name>"
        } else {
            part
        };
        parts.push(shown);
        if !so_far.is_empty() {
            so_far.push('.');
        }
        so_far.push_str(part);
    }
    parts.join(".")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ParameterTree, non_negative};

    fn read(r: &mut Reader<'_>) {
        match r.choice_or("kind", "plain", &["plain", "fancy"], "which one") {
            "fancy" if r.bool_or("loud", false, "whether it is loud") => {
                r.f64("volume", non_negative(), "how loud [dB]");
            }
            _ => {}
        }
        for name in r.children("jets") {
            r.group(&format!("jets.{name}"), |r| r.f64_or("thrust_n", 0.5, non_negative(), "thrust [N]"));
        }
        r.optional_string("limits.whorl_1.note", "a note");
    }

    #[test]
    fn what_stands_behind_choices_is_found_and_names_are_generalised() {
        let text = "/n:\n  ros__parameters:\n    jets: {a: {thrust_n: 1.0}, b: {thrust_n: 2.0}}\n";
        let tree = ParameterTree::from_texts(&[("p.yaml", text)], &[]).unwrap();
        let listed = list_parameters(&[tree.for_node("/n")], &["whorl_1".to_owned()], read);
        let keys: Vec<&str> = listed.iter().map(|p| p.key.as_str()).collect();
        assert_eq!(keys, ["jets.<name>.thrust_n", "kind", "limits.<platform>.note", "loud", "volume"]);
        assert_eq!(listed[0].default, ListedDefault::Value(Value::Double(0.5)));
        assert_eq!(listed[2].default, ListedDefault::None);
        assert_eq!(listed[4].default, ListedDefault::Required);
    }

    #[test]
    fn a_default_that_follows_from_another_choice_is_said_to() {
        let read = |r: &mut Reader<'_>| {
            let default = if r.bool_or("large", false, "size") { 2.0 } else { 1.0 };
            r.f64_or("x", default, non_negative(), "a number");
        };
        let tree = ParameterTree::from_texts(&[("p.yaml", "/n:\n  ros__parameters: {}\n")], &[]).unwrap();
        let listed = list_parameters(&[tree.for_node("/n")], &[], read);
        assert_eq!(listed[1].default, ListedDefault::Depends);
    }
}
