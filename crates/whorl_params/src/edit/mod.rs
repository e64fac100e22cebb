//! Changes one value in a parameter file and leaves the rest of its text as it is: comments, order,
//! spacing, line ends.

mod text;

use std::path::Path;
use std::sync::Arc;

use crate::document::{self, Content, MapEntry, Node};
use crate::error::{Origin, ParameterError, ParameterErrors};
use crate::node_pattern::NodePattern;
use crate::scalar::value_of;
use crate::sections::{is_key, sections_of};
use crate::value::Value;
use text::Editor;

/// Sets a value in a parameter file, as [`set_in_text`] does in a text. The file is replaced as a
/// whole or not at all.
///
/// # Errors
/// As [`set_in_text`]; also when the file cannot be read or written.
pub fn set_in_file(
    path: &Path,
    section: &str,
    key: &str,
    value: &Value,
    comment: Option<&str>,
) -> Result<(), ParameterErrors> {
    let name = path.display().to_string();
    let io = |what: &str, error: std::io::Error| {
        let origin = Origin::File { file: name.as_str().into(), line: 0 };
        ParameterErrors::from(ParameterError::new(origin, format!("cannot be {what}: {error}")))
    };
    let text = whorl_files::read_text(path).map_err(|error| io("read", error))?;
    let edited = set_in_text(&name, &text, section, key, value, comment)?;
    whorl_files::write_file(path, edited).map_err(|error| io("written", error))
}

/// The text of a parameter file with one value set: replaced where the key stands in the section of
/// this name, otherwise added to the innermost existing group, otherwise in a new section at the end.
/// `comment` replaces the comment at the end of that line; `None` keeps it.
///
/// # Errors
/// When the text is not a parameter file, the key is not one or names a group, or the result would
/// not read back to exactly the old parameters and the new value.
pub fn set_in_text(
    name: &str,
    text: &str,
    section: &str,
    key: &str,
    value: &Value,
    comment: Option<&str>,
) -> Result<String, ParameterErrors> {
    let file: Arc<str> = name.into();
    let refuse = |line: usize, problem: String| {
        let origin = Origin::File { file: file.clone(), line };
        ParameterErrors::from(
            ParameterError::new(origin, problem).with_key(key).with_value(value.to_string()),
        )
    };
    if !is_key(key) {
        return Err(refuse(0, "not a parameter name; allowed: letters, digits and _, joined by dots".into()));
    }
    let pattern = NodePattern::parse(&[section]).map_err(|problem| refuse(0, problem))?;
    let root = match document::parse(&file, text) {
        Ok(root) => root,
        Err(errors) => return ParameterErrors::check(errors).map(|()| String::new()),
    };
    let before = if root.is_some() { sections_of(&file, text)? } else { Vec::new() };
    let editor = Editor::new(text, comment);
    let edited = match root.as_ref().and_then(|root| find_section(root, &mut Vec::new(), &pattern)) {
        None => editor.with_new_section(&pattern.to_string(), key, value),
        Some(entry) => match find(entry, key) {
            Place::Value(found) if matches!(found.value.content, Content::Map(_)) => {
                return Err(refuse(
                    found.key_line,
                    "is a group of parameters, not one; allowed: the key of a single value".into(),
                ));
            }
            Place::BelowValue(found) => {
                return Err(refuse(
                    found.key_line,
                    format!("{} is a single value here, not a group", found.key),
                ));
            }
            Place::Value(found) => editor.with_value(found, value),
            Place::Group(group, rest) => {
                editor.with_new_entry(group, rest, value, group.key == "ros__parameters")
            }
        },
    };
    // This check makes the simple text operations above safe.
    let after = sections_of(&file, &edited)?;
    let expected_differs =
        |at: usize, entry: &str| after.get(at).is_some_and(|s| s.pattern == pattern) && entry == key;
    let kept = before.iter().enumerate().all(|(at, old)| {
        after.get(at).is_some_and(|new| {
            let rest = |s: &crate::sections::Section| -> Vec<(String, Value)> {
                s.entries
                    .iter()
                    .filter(|entry| !expected_differs(at, &entry.key))
                    .map(|entry| (entry.key.clone(), entry.value.clone()))
                    .collect()
            };
            // Debug text, so that NaN equals itself.
            format!("{:?}", rest(old)) == format!("{:?}", rest(new))
        })
    });
    let set = after
        .iter()
        .filter(|s| s.pattern == pattern)
        .flat_map(|s| &s.entries)
        .any(|entry| entry.key == key && format!("{:?}", entry.value) == format!("{:?}", reread(value)));
    if kept && set {
        Ok(edited)
    } else {
        Err(refuse(
            0,
            "this file is laid out in a way that cannot be edited automatically; change it by hand".into(),
        ))
    }
}

/// The value as it reads back from YAML (an empty list has no type there).
fn reread(value: &Value) -> Value {
    let file: Arc<str> = "".into();
    match document::parse(&file, &value.to_string()) {
        Ok(Some(node)) => value_of(&node).unwrap_or_else(|_| value.clone()),
        _ => value.clone(),
    }
}

/// The `ros__parameters` entry of the section with this name.
fn find_section<'n>(node: &'n Node, names: &mut Vec<&'n str>, pattern: &NodePattern) -> Option<&'n MapEntry> {
    let Content::Map(entries) = &node.content else { return None };
    for entry in entries {
        if entry.key == "ros__parameters" {
            if NodePattern::parse(names).as_ref() == Ok(pattern) {
                return Some(entry);
            }
            continue;
        }
        names.push(&entry.key);
        let found = find_section(&entry.value, names, pattern);
        names.pop();
        if found.is_some() {
            return found;
        }
    }
    None
}

/// Where a key stands, or would stand.
enum Place<'n, 'k> {
    Value(&'n MapEntry),
    /// The innermost group that exists, and the rest of the key.
    Group(&'n MapEntry, &'k str),
    /// Below a key that is a single value.
    BelowValue(&'n MapEntry),
}

fn find<'n, 'k>(group: &'n MapEntry, key: &'k str) -> Place<'n, 'k> {
    let mut best = Place::Group(group, key);
    let Content::Map(entries) = &group.value.content else { return best };
    for entry in entries {
        if entry.key == key {
            return Place::Value(entry);
        }
        let Some(rest) = key.strip_prefix(entry.key.as_str()).and_then(|rest| rest.strip_prefix('.')) else {
            continue;
        };
        if !matches!(entry.value.content, Content::Map(_)) {
            return Place::BelowValue(entry);
        }
        match find(entry, rest) {
            found @ (Place::Value(_) | Place::BelowValue(_)) => return found,
            Place::Group(inner, inner_rest) => {
                let shorter =
                    matches!(best, Place::Group(_, best_rest) if inner_rest.len() < best_rest.len());
                if shorter {
                    best = Place::Group(inner, inner_rest);
                }
            }
        }
    }
    best
}
