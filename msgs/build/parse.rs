//! Reads `.msg` and `.srv` files (<https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html>).
//!
//! Not supported, and refused with an error: bounded strings and sequences, `wstring`, string
//! constants, defaults of arrays. No message in use needs them.

use std::path::PathBuf;

/// A parsed `.msg` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// Package, e.g. `geometry_msgs`.
    pub package: String,
    /// Name of the type.
    pub name: String,
    /// Lines of the comment at the top.
    pub doc: Vec<String>,
    /// Constants in order.
    pub constants: Vec<Constant>,
    /// Fields in order, which is their order in CDR.
    pub fields: Vec<Field>,
    /// Where the text is.
    pub path: PathBuf,
}

/// A parsed `.srv` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Service {
    /// `NAMERequest`.
    pub request: Definition,
    /// `NAMEResponse`.
    pub response: Definition,
}

/// `TYPE NAME=VALUE`.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    /// Its type.
    pub ty: Primitive,
    /// Its name.
    pub name: String,
    /// Its value as written.
    pub value: String,
    /// Lines of its comment.
    pub doc: Vec<String>,
}

/// `TYPE NAME` or `TYPE NAME DEFAULT`.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Type of the field, or of its elements.
    pub element: Element,
    /// How many elements.
    pub length: Length,
    /// Its name.
    pub name: String,
    /// Its default as written.
    pub default: Option<String>,
    /// Lines of its comment.
    pub doc: Vec<String>,
}

/// How many elements a field has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Length {
    /// One value.
    One,
    /// `[N]`.
    Array(usize),
    /// `[]`.
    Sequence,
}

/// Type of one element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Element {
    /// A number or a truth value.
    Primitive(Primitive),
    /// `string`.
    Text,
    /// Another message: package and name.
    Message(String, String),
}

/// Primitive types: name in `.msg` files and in Rust.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Primitive {
    /// `float64`, ...
    pub ros: &'static str,
    /// `f64`, ...
    pub rust: &'static str,
}

const PRIMITIVES: [Primitive; 13] = [
    Primitive { ros: "bool", rust: "bool" },
    Primitive { ros: "byte", rust: "u8" },
    Primitive { ros: "char", rust: "u8" },
    Primitive { ros: "int8", rust: "i8" },
    Primitive { ros: "uint8", rust: "u8" },
    Primitive { ros: "int16", rust: "i16" },
    Primitive { ros: "uint16", rust: "u16" },
    Primitive { ros: "int32", rust: "i32" },
    Primitive { ros: "uint32", rust: "u32" },
    Primitive { ros: "int64", rust: "i64" },
    Primitive { ros: "uint64", rust: "u64" },
    Primitive { ros: "float32", rust: "f32" },
    Primitive { ros: "float64", rust: "f64" },
];

fn primitive(ros: &str) -> Option<Primitive> {
    PRIMITIVES.iter().copied().find(|primitive| primitive.ros == ros)
}

impl Definition {
    /// Parses a `.msg` file, or one half of a `.srv` file.
    ///
    /// # Errors
    /// The line, counted from 1, and what is wrong with it.
    pub fn parse(package: &str, name: &str, text: &str) -> Result<Self, String> {
        let mut definition = Self {
            package: package.to_owned(),
            name: name.to_owned(),
            doc: Vec::new(),
            constants: Vec::new(),
            fields: Vec::new(),
            path: PathBuf::new(),
        };
        // The comment above the next item; until the first item or empty line it is the message's own.
        let mut above = Vec::new();
        let mut at_top = true;
        for (number, line) in (1..).zip(text.lines()) {
            let (code, comment) = match line.split_once('#') {
                Some((code, comment)) => (code.trim(), Some(comment)),
                None => (line.trim(), None),
            };
            let comment = comment.map(|text| text.strip_prefix(' ').unwrap_or(text).trim_end().to_owned());
            if code.is_empty() {
                match comment {
                    Some(text) if line.starts_with(char::is_whitespace) && above.is_empty() => {
                        definition.go_on(text);
                    }
                    Some(text) => above.push(text),
                    None if at_top && !above.is_empty() => {
                        definition.doc = std::mem::take(&mut above);
                        at_top = false;
                    }
                    None => above.clear(),
                }
                continue;
            }
            if at_top {
                definition.doc = std::mem::take(&mut above);
                at_top = false;
            }
            let mut doc = std::mem::take(&mut above);
            doc.extend(comment);
            definition.item(code, doc).map_err(|problem| format!("line {number}: `{code}`: {problem}"))?;
        }
        Ok(definition)
    }

    /// A further line of the comment behind the latest field.
    fn go_on(&mut self, text: String) {
        if let Some(field) = self.fields.last_mut() {
            field.doc.push(text.trim_start().to_owned());
        }
    }

    fn item(&mut self, code: &str, doc: Vec<String>) -> Result<(), String> {
        let (ty, rest) = code.split_once(char::is_whitespace).ok_or("a type and a name are expected")?;
        let rest = rest.trim();
        if let Some((name, value)) = rest.split_once('=') {
            let ty = primitive(ty).ok_or_else(|| format!("no constant can have the type `{ty}`"))?;
            let name = checked_name(name.trim(), |c| c.is_ascii_uppercase())?;
            self.constants.push(Constant { ty, name, value: value.trim().to_owned(), doc });
            return Ok(());
        }
        let (name, default) = match rest.split_once(char::is_whitespace) {
            Some((name, default)) => (name, Some(default.trim().to_owned())),
            None => (rest, None),
        };
        let (element, length) = self.field_type(ty)?;
        if default.is_some() && (length != Length::One || !matches!(element, Element::Primitive(_))) {
            return Err("only numbers can have a default".to_owned());
        }
        let name = checked_name(name, |c| c.is_ascii_lowercase())?;
        if self.fields.iter().any(|field| field.name == name) {
            return Err(format!("there are two fields `{name}`"));
        }
        self.fields.push(Field { element, length, name, default, doc });
        Ok(())
    }

    fn field_type(&self, ty: &str) -> Result<(Element, Length), String> {
        if ty.contains("<=") || ty == "wstring" {
            return Err(format!("the type `{ty}` is not supported"));
        }
        let (element, length) = match ty.strip_suffix(']').and_then(|ty| ty.split_once('[')) {
            None => (ty, Length::One),
            Some((element, "")) => (element, Length::Sequence),
            Some((element, length)) => {
                (element, Length::Array(length.parse().map_err(|_| format!("`{length}` is no length"))?))
            }
        };
        let element = match (primitive(element), element.split_once('/')) {
            (Some(primitive), _) => Element::Primitive(primitive),
            (None, _) if element == "string" => Element::Text,
            // A name without a package is of the same package.
            (None, None) => Element::Message(self.package.clone(), element.to_owned()),
            (None, Some((package, name))) => Element::Message(package.to_owned(), name.to_owned()),
        };
        Ok((element, length))
    }
}

impl Service {
    /// Parses a `.srv` file.
    ///
    /// # Errors
    /// As [`Definition::parse`]; or that the line `---` is missing.
    pub fn parse(package: &str, name: &str, text: &str) -> Result<Self, String> {
        let (request, response) =
            text.split_once("\n---").ok_or("the line `---` between request and response is missing")?;
        Ok(Self {
            request: Definition::parse(package, &format!("{name}Request"), request)?,
            response: Definition::parse(package, &format!("{name}Response"), response)
                .map_err(|error| format!("in the response, {error}"))?,
        })
    }
}

fn checked_name(name: &str, first: impl Fn(char) -> bool) -> Result<String, String> {
    let valid = name.starts_with(first) && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if valid { Ok(name.to_owned()) } else { Err(format!("`{name}` is no valid name")) }
}
