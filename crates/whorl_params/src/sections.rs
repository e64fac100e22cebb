//! The sections of one parameter file.

use std::collections::HashMap;
use std::sync::Arc;

use crate::document::{self, Content, MapEntry, Node};
use crate::error::{Origin, ParameterError, ParameterErrors};
use crate::node_parameters::Entry;
use crate::node_pattern::NodePattern;
use crate::scalar::value_of;
use crate::shared_groups::{SHARED_GROUPS, is_shared};

#[derive(Debug, Clone)]
pub(crate) struct Section {
    pub pattern: NodePattern,
    pub line: usize,
    pub entries: Vec<Entry>,
}

/// All sections of a file's text, or everything that is wrong with its form.
pub(crate) fn sections_of(file: &Arc<str>, text: &str) -> Result<Vec<Section>, ParameterErrors> {
    let mut errors = Vec::new();
    let sections = sections(file, text, &mut errors);
    ParameterErrors::check(errors).map(|()| sections)
}

/// As [`sections`], of a file that is for one reader alone, such as the map of a CSV file: the name of the
/// section and `ros__parameters` may be left out.
pub(crate) fn sections_for(
    file: &Arc<str>,
    text: &str,
    node: &str,
    errors: &mut Vec<ParameterError>,
) -> Vec<Section> {
    let parsed = document::parse(file, text);
    let root = match &parsed {
        Ok(Some(Node { content: Content::Map(root), .. })) if !root.iter().any(names_parameters) => root,
        // Written like any other file, with the same errors.
        _ => return sections_in(file, parsed, errors),
    };
    let (line, keys) = match root.as_slice() {
        [MapEntry { key, key_line, value: Node { content: Content::Map(inner), .. }, .. }] if key == node => {
            (*key_line, inner)
        }
        _ => (1, root),
    };
    let mut entries = Vec::new();
    flatten(file, "", keys, &mut entries, errors);
    let sections: Vec<Section> =
        NodePattern::parse(&[node]).map(|pattern| Section { pattern, line, entries }).into_iter().collect();
    refuse_duplicates(&sections, errors);
    sections
}

/// Whether `ros__parameters` stands here or below.
fn names_parameters(entry: &MapEntry) -> bool {
    entry.key == "ros__parameters"
        || matches!(&entry.value.content, Content::Map(inner) if inner.iter().any(names_parameters))
}

/// All sections of a file's text; what is wrong with its form is added to `errors`.
pub(crate) fn sections(file: &Arc<str>, text: &str, errors: &mut Vec<ParameterError>) -> Vec<Section> {
    sections_in(file, document::parse(file, text), errors)
}

fn sections_in(
    file: &Arc<str>,
    parsed: Result<Option<Node>, Vec<ParameterError>>,
    errors: &mut Vec<ParameterError>,
) -> Vec<Section> {
    let at = |line| Origin::File { file: file.clone(), line };
    let root = match parsed {
        Ok(Some(root)) => root,
        Ok(None) => {
            errors.push(ParameterError::new(
                at(0),
                "is empty; allowed: at least one section `<node name>: ros__parameters:`",
            ));
            return Vec::new();
        }
        Err(found) => {
            errors.extend(found);
            return Vec::new();
        }
    };
    let Content::Map(entries) = &root.content else {
        errors.push(ParameterError::new(
            at(root.line),
            "expected a map of node names; allowed: sections `<node name>: ros__parameters:`",
        ));
        return Vec::new();
    };
    let mut sections = Vec::new();
    namespace(file, &mut Vec::new(), entries, &mut sections, errors);
    refuse_duplicates(&sections, errors);
    sections
}

const NO_PARAMETERS: &str = "expected `ros__parameters:` with a map below this node name; allowed: \
     `<node name>: ros__parameters:`, where `/**` stands for every node";

/// Sections below a (possibly empty) list of enclosing names.
fn namespace<'a>(
    file: &Arc<str>,
    names: &mut Vec<&'a str>,
    entries: &'a [MapEntry],
    sections: &mut Vec<Section>,
    errors: &mut Vec<ParameterError>,
) {
    for entry in entries {
        let origin = Origin::File { file: file.clone(), line: entry.key_line };
        if entry.key == "ros__parameters" {
            if names.is_empty() {
                errors.push(ParameterError::new(origin, "ros__parameters stands outside a node's section; allowed: `<node name>: ros__parameters:`"));
                continue;
            }
            match section(file, names, entry) {
                Ok(section) => sections.push(section),
                Err(found) => errors.extend(found),
            }
            continue;
        }
        // One error for a section, not one for each of its keys.
        if names.is_empty() && !names_parameters(entry) {
            errors.push(ParameterError::new(origin, NO_PARAMETERS).with_key(entry.key.clone()));
            continue;
        }
        names.push(&entry.key);
        match &entry.value.content {
            Content::Map(inner) => namespace(file, names, inner, sections, errors),
            _ => errors.push(ParameterError::new(origin, NO_PARAMETERS).with_key(entry.key.clone())),
        }
        names.pop();
    }
}

fn section(file: &Arc<str>, names: &[&str], entry: &MapEntry) -> Result<Section, Vec<ParameterError>> {
    let origin = Origin::File { file: file.clone(), line: entry.key_line };
    let pattern =
        NodePattern::parse(names).map_err(|problem| vec![ParameterError::new(origin.clone(), problem)])?;
    let mut entries = Vec::new();
    let mut errors = Vec::new();
    match &entry.value.content {
        Content::Map(map) => flatten(file, "", map, &mut entries, &mut errors),
        // `ros__parameters:` with nothing below is a section without parameters.
        Content::Scalar { text, plain: true } if text.is_empty() => {}
        _ => errors.push(ParameterError::new(origin, "ros__parameters must hold a map of parameters")),
    }
    if pattern.ends_in_wildcard() {
        for entry in entries.iter().filter(|entry| !is_shared(&entry.key)) {
            errors.push(
                ParameterError::new(
                    entry.origin.clone(),
                    format!(
                        "not allowed in section {pattern}; allowed there: {}; keys of one node stand in its own section, such as /**/<node>",
                        SHARED_GROUPS.map(|group| if group == "use_sim_time" { group.to_owned() } else { format!("{group}.*") }).join(", ")
                    ),
                )
                .with_key(entry.key.clone())
                .with_value(entry.value.to_string()),
            );
        }
    }
    if errors.is_empty() { Ok(Section { pattern, line: entry.key_line, entries }) } else { Err(errors) }
}

/// Nested maps to keys joined with dots.
fn flatten(
    file: &Arc<str>,
    prefix: &str,
    map: &[MapEntry],
    entries: &mut Vec<Entry>,
    errors: &mut Vec<ParameterError>,
) {
    for entry in map {
        let key = format!("{prefix}{}", entry.key);
        let origin = Origin::File { file: file.clone(), line: entry.key_line };
        if !is_key(&entry.key) {
            errors.push(
                ParameterError::new(
                    origin,
                    "not a parameter name; allowed: letters, digits and _, joined by dots",
                )
                .with_key(key),
            );
            continue;
        }
        match &entry.value.content {
            Content::Map(inner) => flatten(file, &format!("{key}."), inner, entries, errors),
            _ => match value_of(&entry.value) {
                Ok(value) => entries.push(Entry { key, value, origin }),
                Err(problem) => {
                    let error = ParameterError::new(origin, problem).with_key(key);
                    errors.push(match written(&entry.value) {
                        Some(text) => error.with_value(text),
                        None => error,
                    });
                }
            },
        }
    }
}

fn written(node: &Node) -> Option<String> {
    match &node.content {
        Content::Scalar { text, .. } if !text.is_empty() => Some(text.clone()),
        Content::Sequence(items) => {
            let items: Vec<String> =
                items.iter().map(|item| written(item).unwrap_or_else(|| "...".into())).collect();
            Some(format!("[{}]", items.join(", ")))
        }
        _ => None,
    }
}

pub(crate) fn is_key(key: &str) -> bool {
    key.split('.').all(|part| !part.is_empty() && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'))
}

/// The same key twice for the same node name in one file, be it as `a.b` and `a: {b: ...}` or in
/// two sections of the same name; also a key that is both a value and a group.
fn refuse_duplicates(sections: &[Section], errors: &mut Vec<ParameterError>) {
    let mut seen: HashMap<(String, &str), &Origin> = HashMap::new();
    for section in sections {
        for entry in &section.entries {
            let name = section.pattern.to_string();
            if let Some(first) = seen.get(&(name.clone(), entry.key.as_str())) {
                errors.push(
                    ParameterError::new(
                        entry.origin.clone(),
                        format!(
                            "the key was already given at {first}; allowed: once for a node name in a file"
                        ),
                    )
                    .with_key(entry.key.clone())
                    .with_value(entry.value.to_string()),
                );
            } else {
                seen.insert((name, &entry.key), &entry.origin);
            }
        }
    }
    for section in sections {
        let name = section.pattern.to_string();
        for entry in &section.entries {
            for (dot, _) in entry.key.match_indices('.') {
                let Some(group) = entry.key.get(..dot) else { continue };
                if let Some(value) = seen.get(&(name.clone(), group)) {
                    errors.push(
                        ParameterError::new(
                            entry.origin.clone(),
                            format!(
                                "{group} is a single value at {value}; allowed: either a value or a group"
                            ),
                        )
                        .with_key(entry.key.clone())
                        .with_value(entry.value.to_string()),
                    );
                }
            }
        }
    }
}
