//! Writing and reading the YAML files of a recording (`metadata.yaml`, `manifest.yaml`).

use std::fmt::Write as _;
use std::path::Path;

use saphyr::{LoadableYamlNode, Yaml};
use saphyr_parser::{Event, Parser};

use crate::BagError;

/// Writes block-style YAML line by line.
#[derive(Debug, Default)]
pub(crate) struct YamlWriter {
    text: String,
    indent: usize,
}

impl YamlWriter {
    /// `key: value` with a value that is already YAML.
    pub fn raw(&mut self, key: &str, value: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "{:1$}{key}: {value}", "", self.indent);
    }

    /// `key: "text"`.
    pub fn text(&mut self, key: &str, value: &str) {
        self.raw(key, quoted(value));
    }

    /// `key: number`, so that a reader finds a number also for NaN and infinities.
    pub fn number(&mut self, key: &str, value: f64) {
        self.raw(key, number(value));
    }

    /// `key:` and what `body` writes, indented.
    pub fn group(&mut self, key: &str, body: impl FnOnce(&mut Self)) {
        let _ = writeln!(self.text, "{:1$}{key}:", "", self.indent);
        self.indent += 2;
        body(self);
        self.indent -= 2;
    }

    /// `key:` and one list entry per item; `[]` when there is none.
    pub fn list<T>(
        &mut self,
        key: &str,
        items: impl IntoIterator<Item = T>,
        mut body: impl FnMut(&mut Self, T),
    ) {
        let mut items = items.into_iter().peekable();
        if items.peek().is_none() {
            self.raw(key, "[]");
            return;
        }
        let _ = writeln!(self.text, "{:1$}{key}:", "", self.indent);
        for item in items {
            let start = self.text.len();
            self.indent += 4;
            body(self, item);
            self.indent -= 4;
            // The first line of the entry carries the dash.
            let dash = start + self.indent + 2;
            if self.text.len() > dash {
                self.text.replace_range(dash..=dash, "-");
            }
        }
    }

    /// `key:` and one scalar per item.
    pub fn scalars(&mut self, key: &str, items: &[impl AsRef<str>]) {
        if items.is_empty() {
            self.raw(key, "[]");
            return;
        }
        let _ = writeln!(self.text, "{:1$}{key}:", "", self.indent);
        for item in items {
            let _ = writeln!(self.text, "{:1$}  - {2}", "", self.indent, quoted(item.as_ref()));
        }
    }

    /// Lines that should be YAML already, indented; as a text where they are not.
    pub fn block(&mut self, key: &str, yaml: &str) {
        if too_much(yaml).is_some() || Yaml::load_from_str(yaml).is_err() {
            return self.text(key, yaml);
        }
        let _ = writeln!(self.text, "{:1$}{key}:", "", self.indent);
        for line in yaml.lines() {
            let _ = writeln!(self.text, "{:1$}  {line}", "", self.indent);
        }
    }

    /// The text.
    pub fn finish(self) -> String {
        self.text
    }
}

/// Whether YAML allows a character as it is within a line.
fn is_printed(c: char) -> bool {
    !c.is_control() && !matches!(c, '\u{2028}' | '\u{2029}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}')
}

/// A double-quoted YAML scalar; JSON's escapes are a subset of YAML's. What JSON leaves as it is and YAML does not print, or takes for
/// the end of a line, is escaped as well (YAML 1.2.2, sections 5.1, 5.2 and 5.4).
pub(crate) fn quoted(text: &str) -> String {
    let escaped = |c: char| if is_printed(c) { c.to_string() } else { format!("\\u{:04x}", u32::from(c)) };
    serde_json::Value::from(text).to_string().chars().map(escaped).collect()
}

/// A YAML number.
pub(crate) fn number(value: f64) -> String {
    if value.is_nan() {
        ".nan".into()
    } else if value.is_infinite() {
        if value > 0.0 { ".inf".into() } else { "-.inf".into() }
    } else {
        // `{:?}` keeps every digit and always writes a point or an exponent.
        format!("{value:?}")
    }
}

/// Deeper nesting than any of these files has.
const DEEPEST: usize = 64;
/// More values: a bag of a thousand topics has some ten thousand.
const MOST_VALUES: usize = 500_000;

/// Why a text is not even loaded. Aliases (`*name`) are refused because ten lines of them make gigabytes.
fn too_much(text: &str) -> Option<String> {
    let (mut depth, mut values) = (0usize, 0usize);
    for event in Parser::new_from_str(text) {
        // What is no YAML is told when it is loaded.
        let Ok((event, _)) = event else { return None };
        match event {
            Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
            Event::SequenceEnd | Event::MappingEnd => depth = depth.saturating_sub(1),
            Event::Alias(_) => return Some("it has aliases (*name), which are not allowed".to_owned()),
            Event::Scalar(..) => values += 1,
            _ => {}
        }
        if depth > DEEPEST {
            return Some(format!("it is nested deeper than {DEEPEST} levels"));
        }
        if values > MOST_VALUES {
            return Some(format!("it has more than {MOST_VALUES} values"));
        }
    }
    None
}

/// The first document of a file.
pub(crate) fn load<'a>(path: &Path, text: &'a str) -> Result<Yaml<'a>, BagError> {
    if let Some(reason) = too_much(text) {
        return Err(BagError::Metadata { path: path.to_owned(), reason });
    }
    let documents = Yaml::load_from_str(text)
        .map_err(|error| BagError::Metadata { path: path.to_owned(), reason: error.to_string() })?;
    documents
        .into_iter()
        .next()
        .ok_or_else(|| BagError::Metadata { path: path.to_owned(), reason: "the file is empty".into() })
}

/// Walks down keys. `None` when one is absent.
pub(crate) fn find<'a, 'input>(node: &'a Yaml<'input>, path: &[&str]) -> Option<&'a Yaml<'input>> {
    path.iter().try_fold(node, |node, key| node.as_mapping_get(key))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let mut yaml = YamlWriter::default();
        yaml.text("name", "a \"quoted\": #text\n\u{e9}");
        let unprinted = "\u{feff}a\u{7f}b\u{85}c\u{9f}d\u{2028}e\u{2029}f\u{fffe}g\u{ffff}";
        yaml.text("unprinted", unprinted);
        yaml.number("nan", f64::NAN);
        yaml.number("small", 1e-300);
        yaml.group("group", |y| {
            y.list("items", [1, 2], |y, i| {
                y.raw("id", i);
                y.scalars("tags", &["x", "- y"]);
            });
            y.list("none", [0; 0], |_, _| {});
        });
        let text = yaml.finish();
        let root = load(Path::new("x"), &text).unwrap();
        assert_eq!(find(&root, &["name"]).unwrap().as_str(), Some("a \"quoted\": #text\n\u{e9}"));
        assert_eq!(find(&root, &["unprinted"]).unwrap().as_str(), Some(unprinted));
        assert!(find(&root, &["nan"]).unwrap().as_floating_point().unwrap().is_nan());
        assert_eq!(find(&root, &["small"]).unwrap().as_floating_point(), Some(1e-300));
        let items = find(&root, &["group", "items"]).unwrap().as_sequence().unwrap();
        assert_eq!(items[1].as_mapping_get("id").unwrap().as_integer(), Some(2));
        assert_eq!(items[1].as_mapping_get("tags").unwrap().as_sequence().unwrap()[1].as_str(), Some("- y"));
        assert_eq!(find(&root, &["group", "none"]).unwrap().as_sequence().unwrap().len(), 0);
        assert!(load(Path::new("x"), "").is_err() && load(Path::new("x"), "a: [").is_err());
    }

    #[test]
    fn a_text_that_would_become_gigabytes_is_not_loaded() {
        let refused = |text: &str| load(Path::new("x"), text).unwrap_err().to_string();
        let mut aliases = "a0: &a0 [1,1]\n".to_owned();
        for i in 1..40 {
            aliases += &format!("a{i}: &a{i} [*a{0},*a{0}]\n", i - 1);
        }
        assert!(refused(&aliases).contains("aliases"));
        assert!(refused(&format!("x: {}1{}", "[".repeat(100), "]".repeat(100))).contains("deeper than 64"));
        assert!(refused(&format!("x: [{}]", "1,".repeat(500_001))).contains("more than 500000 values"));
        let mut yaml = YamlWriter::default();
        yaml.block("qos", &aliases);
        assert!(load(Path::new("x"), &yaml.finish()).is_ok(), "kept as a text");
    }
}
