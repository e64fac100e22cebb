//! `-p key:=value` arguments.

use std::sync::Arc;

use crate::document;
use crate::error::{Origin, ParameterError};
use crate::node_pattern::NodePattern;
use crate::scalar::value_of;
use crate::sections::is_key;
use crate::value::Value;

/// One `-p` argument: `key:=value` or `node:key:=value`, where the value is YAML and the node may
/// have wildcards, as in parameter files.
#[derive(Debug, Clone, PartialEq)]
pub struct Override {
    node: Option<NodePattern>,
    key: String,
    value: Value,
}

impl Override {
    /// Parses the text after `-p`.
    ///
    /// # Errors
    /// When it has no `:=`, the key is not one, or the value is not a value of a parameter.
    pub fn parse(argument: &str) -> Result<Self, ParameterError> {
        let refuse = |problem: String| ParameterError::new(Origin::CommandLine, problem).with_value(argument);
        let Some((name, text)) = argument.split_once(":=") else {
            return Err(refuse("not of the form key:=value or node:key:=value".into()));
        };
        let (node, key) = match name.split_once(':') {
            Some((node, key)) => (Some(NodePattern::parse(&[node]).map_err(refuse)?), key),
            None => (None, name),
        };
        if !is_key(key) {
            return Err(refuse(format!(
                "`{key}` is not a parameter name; allowed: letters, digits and _, joined by dots"
            )));
        }
        let file: Arc<str> = "-p".into();
        let document = document::parse(&file, text).map_err(|errors| {
            refuse(errors.first().map_or_else(String::new, |error| error.problem.clone()))
        })?;
        let Some(document) = document else {
            return Err(refuse("has no value".into()));
        };
        let value = value_of(&document).map_err(refuse)?;
        Ok(Self { node, key: key.to_owned(), value })
    }

    /// The parameter's key.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }

    /// The value.
    #[must_use]
    pub fn value(&self) -> &Value {
        &self.value
    }

    /// The node that it names, perhaps with wildcards; empty: every node.
    #[must_use]
    pub fn node(&self) -> String {
        self.node.as_ref().map_or_else(String::new, ToString::to_string)
    }

    /// Whether the argument is meant for this node (fully qualified name).
    #[must_use]
    pub fn applies_to(&self, node: &str) -> bool {
        self.node.as_ref().is_none_or(|pattern| pattern.matches(node))
    }
}
