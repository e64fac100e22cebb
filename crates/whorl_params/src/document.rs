//! YAML text to a tree with positions.
//!
//! Only the part of YAML that ROS 2 parameter files use: one document of maps, lists and scalars.
//! Anchors, aliases and tags are refused, duplicate keys too.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use saphyr_parser::{Event, Parser, ScalarStyle, ScanError, Span, StrInput};

use crate::error::{Origin, ParameterError};

/// Deeper nesting than any parameter file needs; bounds the recursion.
const MAX_DEPTH: usize = 32;
/// More keys than any parameter file has: those of eight platforms have some two thousand.
const MOST_KEYS: usize = 10_000;
/// More values: measured curves have thousands of knots.
const MOST_VALUES: usize = 500_000;
/// Errors after which the rest of a file is not looked at.
const MOST_ERRORS: usize = 200;

/// A YAML node.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    /// Line of its first character, from 1.
    pub line: usize,
    /// Its characters (not bytes). For block maps and lists the end may include what follows.
    pub span: Range<usize>,
    pub content: Content,
}

#[derive(Debug, Clone)]
pub(crate) enum Content {
    Scalar { text: String, plain: bool },
    Sequence(Vec<Node>),
    Map(Vec<MapEntry>),
}

#[derive(Debug, Clone)]
pub(crate) struct MapEntry {
    pub key: String,
    pub key_line: usize,
    /// Column of the key's first character, from 0.
    pub key_column: usize,
    pub value: Node,
}

/// Parses one document. `None` when it holds nothing but comments.
pub(crate) fn parse(file: &Arc<str>, text: &str) -> Result<Option<Node>, Vec<ParameterError>> {
    let mut builder = Builder {
        file,
        parser: Parser::new_from_str(text),
        errors: Vec::new(),
        root: None,
        keys: 0,
        values: 0,
    };
    // A syntax error ends the parse; errors found before it are reported with it.
    if let Err(error) = builder.document() {
        builder.errors.push(error);
    }
    if builder.errors.is_empty() { Ok(builder.root) } else { Err(builder.errors) }
}

struct Builder<'a> {
    file: &'a Arc<str>,
    parser: Parser<'a, StrInput<'a>>,
    errors: Vec<ParameterError>,
    root: Option<Node>,
    keys: usize,
    values: usize,
}

impl<'a> Builder<'a> {
    fn at(&self, line: usize, problem: impl Into<String>) -> ParameterError {
        ParameterError::new(Origin::File { file: self.file.clone(), line }, problem)
    }

    fn next(&mut self) -> Result<(Event<'a>, Span), ParameterError> {
        match self.parser.next_event() {
            Some(Ok(event)) => Ok(event),
            Some(Err(error)) => Err(self.syntax(&error)),
            None => Ok((Event::StreamEnd, Span::default())),
        }
    }

    fn syntax(&self, error: &ScanError) -> ParameterError {
        self.at(error.marker().line(), format!("not valid YAML: {}", error.info()))
    }

    fn document(&mut self) -> Result<(), ParameterError> {
        loop {
            let (event, span) = self.next()?;
            match event {
                Event::StreamEnd => return Ok(()),
                Event::Nothing | Event::StreamStart | Event::DocumentStart(_) | Event::DocumentEnd => {}
                event => {
                    if self.root.is_some() {
                        return Err(self
                            .at(span.start.line(), "a second YAML document; allowed: one document a file"));
                    }
                    let node = self.node(event, span, 0)?;
                    // An empty document arrives as an empty scalar.
                    let empty =
                        matches!(&node.content, Content::Scalar { text, plain: true } if text.is_empty());
                    if !empty {
                        self.root = Some(node);
                    }
                }
            }
        }
    }

    fn node(&mut self, event: Event<'a>, span: Span, depth: usize) -> Result<Node, ParameterError> {
        let line = span.start.line();
        if depth > MAX_DEPTH {
            return Err(self.at(line, format!("nested deeper than {MAX_DEPTH} levels")));
        }
        self.values += 1;
        if self.values > MOST_VALUES {
            return Err(self.at(
                line,
                format!("more than {MOST_VALUES} values; allowed: up to {MOST_VALUES} in a file"),
            ));
        }
        if self.errors.len() >= MOST_ERRORS {
            return Err(self.at(line, "there is more wrong in this file: it is not read any further"));
        }
        let (anchored, tagged) = match &event {
            Event::Scalar(_, _, anchor, tag) => (*anchor != 0, tag.is_some()),
            Event::SequenceStart(anchor, tag) | Event::MappingStart(anchor, tag) => {
                (*anchor != 0, tag.is_some())
            }
            _ => (false, false),
        };
        if anchored {
            self.errors.push(self.at(line, "YAML anchors (&name) are not allowed in parameter files"));
        }
        if tagged {
            self.errors.push(self.at(line, "YAML tags (!name) are not allowed in parameter files"));
        }
        match event {
            Event::Scalar(text, style, ..) => Ok(Node {
                line,
                span: span.start.index()..span.end.index(),
                content: Content::Scalar { text: text.into_owned(), plain: style == ScalarStyle::Plain },
            }),
            Event::SequenceStart(..) => self.sequence(span, depth),
            Event::MappingStart(..) => self.map(span, depth),
            Event::Alias(_) => Err(self.at(line, "YAML aliases (*name) are not allowed in parameter files")),
            _ => Err(self.at(line, "not valid YAML: a value is missing")),
        }
    }

    fn sequence(&mut self, start: Span, depth: usize) -> Result<Node, ParameterError> {
        let mut items = Vec::new();
        loop {
            let (event, span) = self.next()?;
            if matches!(event, Event::SequenceEnd | Event::StreamEnd) {
                return Ok(Node {
                    line: start.start.line(),
                    span: start.start.index()..span.end.index(),
                    content: Content::Sequence(items),
                });
            }
            items.push(self.node(event, span, depth + 1)?);
        }
    }

    fn map(&mut self, start: Span, depth: usize) -> Result<Node, ParameterError> {
        let mut entries: Vec<MapEntry> = Vec::new();
        let mut lines: HashMap<String, usize> = HashMap::new();
        loop {
            let (event, span) = self.next()?;
            if matches!(event, Event::MappingEnd | Event::StreamEnd) {
                return Ok(Node {
                    line: start.start.line(),
                    span: start.start.index()..span.end.index(),
                    content: Content::Map(entries),
                });
            }
            let key_line = span.start.line();
            let key_node = self.node(event, span, depth + 1)?;
            let Content::Scalar { text: key, .. } = key_node.content else {
                return Err(self.at(key_line, "a key must be a single word, not a list or map"));
            };
            let (event, value_span) = self.next()?;
            let value = self.node(event, value_span, depth + 1)?;
            self.keys += 1;
            if self.keys > MOST_KEYS {
                return Err(self.at(
                    key_line,
                    format!("more than {MOST_KEYS} keys; allowed: up to {MOST_KEYS} in a file"),
                ));
            }
            if let Some(first) = lines.get(&key) {
                let problem = format!("the key stands here and on line {first}; allowed: once");
                self.errors.push(self.at(key_line, problem).with_key(key));
            } else {
                lines.insert(key.clone(), key_line);
                entries.push(MapEntry { key, key_line, key_column: span.start.col(), value });
            }
        }
    }
}
