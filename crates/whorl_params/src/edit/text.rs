//! Operations on the text of a parameter file, by the positions of its nodes.

use std::ops::Range;

use crate::document::{Content, MapEntry, Node};
use crate::value::Value;

/// Edits the text of one parameter file; all methods return the whole new text.
pub(super) struct Editor<'t> {
    text: &'t str,
    /// Byte offset of each character, and of the end.
    offsets: Vec<usize>,
    newline: &'static str,
    comment: Option<String>,
}

impl<'t> Editor<'t> {
    pub(super) fn new(text: &'t str, comment: Option<&str>) -> Self {
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

    pub(super) fn with_value(&self, entry: &MapEntry, value: &Value) -> String {
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

    pub(super) fn with_new_entry(
        &self,
        group: &MapEntry,
        key: &str,
        value: &Value,
        is_section: bool,
    ) -> String {
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

    pub(super) fn with_new_section(&self, section: &str, key: &str, value: &Value) -> String {
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
