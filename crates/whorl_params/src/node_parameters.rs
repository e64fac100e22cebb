//! The parameters of one node, after layering and before validation.

use std::collections::HashMap;
use std::sync::Arc;

use crate::error::Origin;
use crate::shared_groups::is_shared;
use crate::value::Value;

/// A key with its value and where that came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Full key with dots.
    pub key: String,
    /// Its value.
    pub value: Value,
    /// Where the value was given.
    pub origin: Origin,
}

/// The parameters of one node: a flat map from dotted keys to values, in file order.
#[derive(Debug, Clone)]
pub struct NodeParameters {
    node: Arc<str>,
    files: Vec<Arc<str>>,
    entries: Vec<Entry>,
    index: HashMap<String, usize>,
}

impl NodeParameters {
    pub(crate) fn new(node: &str, files: Vec<Arc<str>>) -> Self {
        Self { node: node.into(), files, entries: Vec::new(), index: HashMap::new() }
    }

    /// The node's fully qualified name.
    #[must_use]
    pub fn node(&self) -> &str {
        &self.node
    }

    pub(crate) fn node_origin(&self) -> Origin {
        Origin::Node { node: self.node.clone() }
    }

    pub(crate) fn files(&self) -> &[Arc<str>] {
        &self.files
    }

    /// Adds an entry, or replaces the one of the same key at its place in the order.
    pub(crate) fn insert(&mut self, entry: Entry) {
        match self.index.get(&entry.key).and_then(|&at| self.entries.get_mut(at)) {
            Some(present) => *present = entry,
            None => {
                self.index.insert(entry.key.clone(), self.entries.len());
                self.entries.push(entry);
            }
        }
    }

    /// The entry of a key.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<&Entry> {
        self.index.get(key).and_then(|&at| self.entries.get(at))
    }

    /// All entries, in file order.
    pub fn iter(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter()
    }

    /// A copy with one value changed, as by `ros2 param set`. Read the copy with the node's
    /// reader to validate the whole set again.
    #[must_use]
    pub fn with(&self, key: &str, value: Value) -> Self {
        let mut changed = self.clone();
        changed.insert(Entry { key: key.to_owned(), value, origin: Origin::RunTime });
        changed
    }

    /// A copy without the keys of the node itself.
    pub(crate) fn only_shared(&self) -> Self {
        let mut shared = Self::new(&self.node, self.files.clone());
        self.entries
            .iter()
            .filter(|entry| is_shared(&entry.key))
            .for_each(|entry| shared.insert(entry.clone()));
        shared
    }

    /// Whether there are names below a prefix.
    pub(crate) fn has_children(&self, prefix: &str) -> bool {
        let is_below = |key: &str| key.strip_prefix(prefix).is_some_and(|rest| rest.starts_with('.'));
        self.entries.iter().any(|entry| is_below(&entry.key))
    }

    /// Names below a prefix, in file order: `children("jets")` of `jets.a.thrust_n`,
    /// `jets.b.thrust_n` is `a`, `b`.
    #[must_use]
    pub fn children(&self, prefix: &str) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for entry in &self.entries {
            let Some(rest) = entry.key.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('.')) else {
                continue;
            };
            let name = rest.split_once('.').map_or(rest, |(name, _)| name);
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }
}
