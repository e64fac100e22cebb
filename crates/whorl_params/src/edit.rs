//! Changes one value in a parameter file and leaves the rest of its text as it is: comments, order,
//! spacing, line ends.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use crate::document::{self, Content, MapEntry, Node};
use crate::error::{Origin, ParameterError, ParameterErrors};
use crate::node_pattern::NodePattern;
use crate::scalar::value_of;
use crate::tree::{is_key, sections_of};
use crate::value::Value;

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
    let text = std::fs::read_to_string(path).map_err(|error| io("read", error))?;
    let edited = set_in_text(&name, &text, section, key, value, comment)?;
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    let write = || {
        std::fs::write(&beside, edited)?;
        std::fs::set_permissions(&beside, std::fs::metadata(path)?.permissions())?;
        std::fs::rename(&beside, path)
    };
    write().map_err(|error| {
        // The original is untouched; only the leftover goes.
        let _ = std::fs::remove_file(&beside);
        io("written", error)
    })
}

/// The text of a parameter file with one value set: replaced where the key stands in the section of
/// this name, else added to the innermost group that exists, else in a new section at the end.
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
    // The text operations above are simple; this is what makes them safe.
    let after = sections_of(&file, &edited)?;
    let expected_differs =
        |at: usize, entry: &str| after.get(at).is_some_and(|s| s.pattern == pattern) && entry == key;
    let kept = before.iter().enumerate().all(|(at, old)| {
        after.get(at).is_some_and(|new| {
            let rest = |s: &crate::tree::Section| -> Vec<(String, Value)> {
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

struct Editor<'t> {
    text: &'t str,
    /// Byte offset of each character, and of the end.
    offsets: Vec<usize>,
    newline: &'static str,
    comment: Option<String>,
}

impl<'t> Editor<'t> {
    fn new(text: &'t str, comment: Option<&str>) -> Self {
        Self {
            text,
            offsets: text.char_indices().map(|(at, _)| at).chain([text.len()]).collect(),
            newline: if text.contains("\r\n") { "\r\n" } else { "\n" },
            comment: comment.map(|comment| comment.replace(['\n', '\r'], " ")),
        }
    }

    /// Byte range of a character range, cut to the text, without what a parser may count to a
    /// value although it follows it: spaces, and the comment behind a quoted text.
    fn bytes(&self, characters: &Range<usize>) -> Range<usize> {
        let byte = |at: usize| self.offsets.get(at).copied().unwrap_or(self.text.len());
        let start = byte(characters.start);
        let text = self.text.get(start..byte(characters.end)).unwrap_or_default();
        let length = match text.chars().next() {
            Some(quote @ ('"' | '\'')) => quoted_length(text, quote),
            _ => text.trim_end().len(),
        };
        start..start + length
    }

    /// End of a node's text, in bytes. The span of a block map or list may reach beyond it.
    fn end(&self, node: &Node) -> usize {
        let last = match &node.content {
            Content::Map(entries) if !self.is_flow(node) => entries.last().map(|entry| &entry.value),
            Content::Sequence(items) if !self.is_flow(node) => items.last(),
            _ => None,
        };
        last.map_or_else(|| self.bytes(&node.span).end, |last| self.end(last))
    }

    fn is_flow(&self, node: &Node) -> bool {
        self.text.get(self.bytes(&node.span)).is_some_and(|text| text.starts_with(['{', '[']))
    }

    /// End of the line that a byte stands on, without its line end.
    fn line_end(&self, from: usize) -> usize {
        let rest = self.text.get(from..).unwrap_or_default();
        from + rest.find(['\r', '\n']).unwrap_or(rest.len())
    }

    /// Replaces bytes and sets the comment at the end of the line on which they end.
    fn replace(&self, range: Range<usize>, by: &str) -> String {
        let line_end = self.line_end(range.end);
        let rest = self.text.get(range.end..line_end).unwrap_or_default();
        let rest = match &self.comment {
            None => rest.to_owned(),
            Some(comment) => {
                let kept = rest.get(..comment_start(rest)).unwrap_or(rest).trim_end();
                format!("{kept}  # {comment}")
            }
        };
        let head = self.text.get(..range.start).unwrap_or_default();
        let tail = self.text.get(line_end..).unwrap_or_default();
        format!("{head}{by}{rest}{tail}")
    }

    fn with_value(&self, entry: &MapEntry, value: &Value) -> String {
        let range = match &entry.value.content {
            Content::Sequence(_) if !self.is_flow(&entry.value) => {
                // A block list starts on its own line; the new value stands behind the key.
                let start = self.bytes(&entry.value.span).start;
                let head = self.text.get(..start).unwrap_or_default();
                let key_end = head.rfind(':').map_or(start, |colon| colon + 1);
                return self.replace(key_end..self.end(&entry.value), &format!(" {value}"));
            }
            _ => self.bytes(&entry.value.span),
        };
        self.replace(range, &value.to_string())
    }

    fn with_new_entry(&self, group: &MapEntry, key: &str, value: &Value, is_section: bool) -> String {
        match &group.value.content {
            Content::Map(entries) => match (entries.last(), self.is_flow(&group.value)) {
                (Some(last), true) => {
                    let end = self.end(&last.value);
                    self.replace(end..end, &format!(", {}", flow(key, value)))
                }
                (None, true) if !is_section => {
                    self.replace(self.bytes(&group.value.span), &format!("{{{}}}", flow(key, value)))
                }
                (Some(last), false) => self.insert_lines(self.end(&last.value), last.key_column, key, value),
                (None, _) => {
                    let braces = self.bytes(&group.value.span);
                    let head = self.text.get(..braces.start).unwrap_or_default().trim_end();
                    let tail = self.text.get(braces.end..).unwrap_or_default();
                    let lines = self.lines(group.key_column + 2, key, value);
                    format!("{head}{}{lines}{tail}", self.newline)
                }
            },
            // `ros__parameters:` with nothing below.
            _ => self.insert_lines(self.bytes(&group.value.span).start, group.key_column + 2, key, value),
        }
    }

    fn with_new_section(&self, section: &str, key: &str, value: &Value) -> String {
        let mut text = self.text.to_owned();
        if !text.is_empty() {
            if !text.ends_with('\n') {
                text.push_str(self.newline);
            }
            text.push_str(self.newline);
        }
        let newline = self.newline;
        format!("{text}{section}:{newline}  ros__parameters:{newline}{}{newline}", self.lines(4, key, value))
    }

    /// Adds lines after the one on which byte `after` stands.
    fn insert_lines(&self, after: usize, indent: usize, key: &str, value: &Value) -> String {
        let at = self.line_end(after);
        let head = self.text.get(..at).unwrap_or_default();
        let tail = self.text.get(at..).unwrap_or_default();
        let tail = if tail.is_empty() { self.newline } else { tail };
        format!("{head}{}{}{tail}", self.newline, self.lines(indent, key, value))
    }

    /// Nested lines for a dotted key, without the last line end.
    fn lines(&self, indent: usize, key: &str, value: &Value) -> String {
        let parts: Vec<&str> = key.split('.').collect();
        let lines: Vec<String> = parts
            .iter()
            .enumerate()
            .map(|(depth, part)| format!("{}{part}:", " ".repeat(indent + 2 * depth)))
            .collect();
        let comment = self.comment.as_ref().map(|comment| format!("  # {comment}")).unwrap_or_default();
        format!("{} {value}{comment}", lines.join(self.newline))
    }
}

/// `a.b` as `a: {b: value}`.
fn flow(key: &str, value: &Value) -> String {
    match key.split_once('.') {
        None => format!("{key}: {value}"),
        Some((group, rest)) => format!("{group}: {{{}}}", flow(rest, value)),
    }
}

/// Length in bytes of the quoted text that a text starts with, quotes included.
fn quoted_length(text: &str, quote: char) -> usize {
    let mut characters = text.char_indices().skip(1).peekable();
    while let Some((at, c)) = characters.next() {
        let next_is_quote = characters.peek().is_some_and(|(_, next)| *next == quote);
        if c == '\\' && quote == '"' || c == '\'' && quote == '\'' && next_is_quote {
            characters.next();
        } else if c == quote {
            return at + 1;
        }
    }
    text.len()
}

/// Where a comment starts in the rest of a line that begins outside quotes; its length if none does.
fn comment_start(line: &str) -> usize {
    let mut quote = None;
    let mut previous = ' ';
    for (at, c) in line.char_indices() {
        match quote {
            Some(open) if c == open => quote = None,
            Some(_) => {}
            None if c == '#' && previous.is_whitespace() => return at,
            None if matches!(c, '"' | '\'') => quote = Some(c),
            None => {}
        }
        previous = c;
    }
    line.len()
}
