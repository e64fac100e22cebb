//! Writes Rust from parsed definitions.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::OWN_PACKAGE;
use crate::parse::{Constant, Definition, Element, Field, Length, Service};

/// Longest array for which serde and the standard library have their traits.
const LONGEST_PLAIN_ARRAY: usize = 32;
/// Names of fields that Rust keeps for itself.
const KEYWORDS: [&str; 8] = ["type", "final", "in", "loop", "match", "mod", "ref", "use"];

/// The type that a visitor sees as one value.
const TIME: (&str, &str) = ("builtin_interfaces", "Time");

/// What is true of a type and decides what it derives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Traits {
    copy: bool,
    eq: bool,
}

/// One module for each package; our own is called `whorl` and has the services.
///
/// # Errors
/// When a definition names one that there is not.
pub fn packages(definitions: &[Definition], services: &[Service]) -> Result<String, String> {
    let mut by_package = BTreeMap::<&str, Vec<&Definition>>::new();
    for definition in definitions {
        by_package.entry(&definition.package).or_default().push(definition);
    }
    let mut text = String::new();
    for (package, members) in by_package {
        let own = package == OWN_PACKAGE;
        let module = if own { "whorl" } else { package };
        let _ = write!(
            text,
            "/// Messages of the package `{package}`.\n\
             #[allow(missing_docs, rustdoc::bare_urls, reason = \"the comments are those of the definitions\")]\n\
             pub mod {module} {{\n"
        );
        for definition in members {
            text += &structure(definition, definitions)?;
        }
        if own {
            text += "/// Requests and responses of the services.\npub mod srv {\n";
            for service in services {
                text += &structure(&service.request, definitions)?;
                text += &structure(&service.response, definitions)?;
            }
            text += "}\n";
        }
        text += "}\n\n";
    }
    Ok(text)
}

/// The table of definitions.
pub fn table(definitions: &[Definition]) -> String {
    let mut text = String::from(
        "/// Every definition in `msg/` and `standard/`.\npub const DEFINITIONS: &[Definition] = &[\n",
    );
    for definition in definitions {
        let _ = write!(
            text,
            "Definition {{ name: \"{}/{}\", text: include_str!({:?}), fields: &[",
            definition.package,
            definition.name,
            definition.path.display().to_string()
        );
        for field in &definition.fields {
            let _ = write!(text, "Field {{ ty: \"{}\", name: \"{}\" }}, ", ros_type(field), field.name);
        }
        text += "] },\n";
    }
    text + "];\n"
}

/// The call of the macro `messages!` with every message, and what can be asked of any of them.
///
/// # Errors
/// When two packages have a message of the same name.
pub fn messages(definitions: &[Definition]) -> Result<String, String> {
    let mut text = String::from("messages! {\n");
    let mut seen = BTreeMap::<&str, &str>::new();
    for definition in definitions {
        let (package, name) = (definition.package.as_str(), definition.name.as_str());
        if let Some(other) = seen.insert(name, package) {
            return Err(format!("{other}/{name} and {package}/{name}: a name can be used once"));
        }
        let module = if package == OWN_PACKAGE { "whorl" } else { package };
        let _ = writeln!(text, "    {name}(crate::{module}::{name}) \"{package}/msg/{name}\";");
    }
    text += "}\n\nimpl Message {\n";
    text += "/// Stamp and frame, of a message that has a header.\n#[must_use]\n";
    text += "pub fn header(&self) -> Option<&crate::std_msgs::Header> {\n";
    text += &field_of_any(definitions, "header", "std_msgs/Header", "Some(&m.header)");
    text += "}\n\n/// The message's own sequence number, of those that carry one.\n#[must_use]\n";
    text += "pub fn sequence(&self) -> Option<u64> {\n";
    text += &field_of_any(definitions, "sequence", "uint64", "Some(m.sequence)");
    Ok(text + "}\n}\n")
}

/// A `match` that gives `found` for each message with this field.
fn field_of_any(definitions: &[Definition], name: &str, ty: &str, found: &str) -> String {
    let mut text = String::from("match self {\n");
    let has = |d: &&Definition| d.fields.iter().any(|f| f.name == name && ros_type(f) == ty);
    for definition in definitions.iter().filter(has) {
        let _ = writeln!(text, "Self::{}(m) => {found},", definition.name);
    }
    text + "_ => None,\n}\n"
}

fn structure(definition: &Definition, all: &[Definition]) -> Result<String, String> {
    let traits = traits_of(definition, all)?;
    let default_written = definition.fields.iter().any(|field| {
        field.default.is_some() || matches!(field.length, Length::Array(n) if n > LONGEST_PLAIN_ARRAY)
    });
    let name = &definition.name;
    let mut text = doc(&definition.doc);
    text += "#[derive(Debug, Clone, ";
    text += if traits.copy { "Copy, " } else { "" };
    text += if traits.eq { "Eq, " } else { "" };
    text += if default_written { "" } else { "Default, " };
    let _ = write!(text, "PartialEq, serde::Serialize, serde::Deserialize)]\npub struct {name} {{\n");
    for field in &definition.fields {
        text += &doc(&field.doc);
        if matches!(field.length, Length::Array(n) if n > LONGEST_PLAIN_ARRAY) {
            text += "#[serde(with = \"serde_big_array::BigArray\")]\n";
        }
        let _ = writeln!(text, "pub {}: {},", identifier(&field.name), rust_type(field));
    }
    text += "}\n\n";
    if default_written {
        let _ = write!(
            text,
            "impl Default for {name} {{\n/// Defaults of the definition; zero and empty where it has none.\n\
             fn default() -> Self {{\nSelf {{\n"
        );
        for field in &definition.fields {
            let _ = writeln!(text, "{}: {},", identifier(&field.name), default_of(field));
        }
        text += "}\n}\n}\n\n";
    }
    if (definition.package.as_str(), name.as_str()) != TIME {
        text += &walk(definition);
    }
    if !definition.constants.is_empty() {
        let _ = writeln!(text, "impl {name} {{");
        for Constant { ty, name, value, doc: lines } in &definition.constants {
            text += &doc(lines);
            let _ = writeln!(text, "pub const {name}: {} = {value};", ty.rust);
        }
        text += "}\n\n";
    }
    Ok(text)
}

/// Shows a visitor every field.
fn walk(definition: &Definition) -> String {
    let mut text = format!(
        "impl crate::fields::Fields for {} {{\n\
         fn walk(&mut self, name: &'static str, visitor: &mut dyn crate::fields::Visitor) {{\n\
         visitor.enter(name);\n",
        definition.name
    );
    for field in &definition.fields {
        let _ = writeln!(
            text,
            "crate::fields::Fields::walk(&mut self.{}, {:?}, visitor);",
            identifier(&field.name),
            field.name
        );
    }
    text + "visitor.leave();\n}\n}\n\n"
}

/// Rust attributes with the text of a comment, so that it reads as Markdown.
fn doc(lines: &[String]) -> String {
    let mut text = String::new();
    for line in lines {
        let _ = writeln!(text, "#[doc = {:?}]", markdown(line));
    }
    text
}

/// Plain text as Markdown: units in brackets are no links, `<platform>` is no tag, `HEALTH_*` no emphasis.
fn markdown(line: &str) -> String {
    let mut text = String::from(" ");
    let mut in_code = false;
    for c in line.chars() {
        in_code ^= c == '`';
        if !in_code && matches!(c, '[' | ']' | '<' | '>' | '*') {
            text.push('\\');
        }
        text.push(c);
    }
    text
}

/// The type as definitions write it, with its package.
fn ros_type(field: &Field) -> String {
    let element = match &field.element {
        Element::Primitive(primitive) => primitive.ros.to_owned(),
        Element::Text => "string".to_owned(),
        Element::Message(package, name) => format!("{package}/{name}"),
    };
    match field.length {
        Length::One => element,
        Length::Array(n) => format!("{element}[{n}]"),
        Length::Sequence => format!("{element}[]"),
    }
}

fn rust_type(field: &Field) -> String {
    let element = match &field.element {
        Element::Primitive(primitive) => primitive.rust.to_owned(),
        Element::Text => "String".to_owned(),
        Element::Message(package, name) if package == OWN_PACKAGE => format!("crate::whorl::{name}"),
        Element::Message(package, name) => format!("crate::{package}::{name}"),
    };
    match field.length {
        Length::One => element,
        Length::Array(n) => format!("[{element}; {n}]"),
        Length::Sequence => format!("Vec<{element}>"),
    }
}

fn default_of(field: &Field) -> String {
    match (&field.element, field.length, &field.default) {
        (Element::Primitive(p), Length::One, Some(value)) if p.rust.starts_with('f') => {
            format!("{value}_{}", p.rust)
        }
        (_, _, Some(value)) => value.clone(),
        (Element::Primitive(p), Length::Array(n), None) => match p.rust {
            "bool" => format!("[false; {n}]"),
            float if float.starts_with('f') => format!("[0.0; {n}]"),
            _ => format!("[0; {n}]"),
        },
        (_, Length::Array(_), None) => "std::array::from_fn(|_| Default::default())".to_owned(),
        _ => "Default::default()".to_owned(),
    }
}

fn identifier(name: &str) -> String {
    if KEYWORDS.contains(&name) { format!("r#{name}") } else { name.to_owned() }
}

/// A type of numbers alone can be copied; one without floating-point numbers has an exact equality.
fn traits_of(definition: &Definition, all: &[Definition]) -> Result<Traits, String> {
    let mut traits = Traits { copy: true, eq: true };
    for field in &definition.fields {
        let of_element = match &field.element {
            Element::Primitive(primitive) => Traits { copy: true, eq: !primitive.rust.starts_with('f') },
            Element::Text => Traits { copy: false, eq: true },
            Element::Message(package, name) => {
                let nested = all.iter().find(|d| d.package == *package && d.name == *name);
                let nested = nested.ok_or_else(|| {
                    format!(
                        "{}/{}: field {}: there is no {package}/{name}.msg",
                        definition.package, definition.name, field.name
                    )
                })?;
                traits_of(nested, all)?
            }
        };
        traits.copy &= of_element.copy && field.length != Length::Sequence;
        traits.eq &= of_element.eq;
    }
    Ok(traits)
}
