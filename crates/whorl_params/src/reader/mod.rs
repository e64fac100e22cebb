//! Reads a node's parameters: types, ranges, docs and values in one place.

mod lists;
mod numbers;
mod texts;

use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};

use whorl_math::words::nearest;

use crate::descriptor::{Descriptor, NumericRange};
use crate::error::{ParameterError, ParameterErrors};
use crate::node_parameters::{Entry, NodeParameters};
use crate::shared_groups::is_shared;
use crate::value::{Kind, Value};

/// Reads the parameters of a node.
///
/// Every read returns a value, a harmless placeholder when the parameter is missing or wrong, and
/// [`Reader::finish`] reports all errors at once. So one function that reads a node's parameters
/// is the single definition of their names, types, ranges, defaults and docs.
///
/// Keys are relative to the groups that are open ([`Reader::group`]).
#[derive(Debug)]
pub struct Reader<'a> {
    parameters: &'a NodeParameters,
    prefix: String,
    read_only: bool,
    /// (model prefix, overlaying prefix), both with their final dot.
    overlay: Option<(String, String)>,
    descriptors: Vec<Descriptor>,
    described: HashMap<String, usize>,
    /// Full keys of all reads.
    known: BTreeSet<String>,
    /// Shared groups that this node reads in full, with their final dot.
    claimed: Vec<String>,
    /// Groups whose members the user names, full.
    named: RefCell<BTreeSet<String>>,
    errors: Vec<ParameterError>,
}

/// Properties of a read.
pub(crate) struct Request<'r> {
    pub key: &'r str,
    pub kind: Kind,
    /// What is allowed, in words.
    pub allowed: String,
    pub range: Option<NumericRange>,
    pub choices: Vec<String>,
    pub doc: &'r str,
}

/// What to do about a key that is not set.
pub(crate) enum Absent {
    /// It is an error.
    Refuse,
    /// This value is in force.
    Default(Value),
    /// There is none.
    Leave,
}

impl<'a> Reader<'a> {
    /// A reader of one node's parameters.
    #[must_use]
    pub fn new(parameters: &'a NodeParameters) -> Self {
        Self {
            parameters,
            prefix: String::new(),
            read_only: false,
            overlay: None,
            descriptors: Vec::new(),
            described: HashMap::new(),
            known: BTreeSet::new(),
            claimed: Vec::new(),
            named: RefCell::new(BTreeSet::new()),
            errors: Vec::new(),
        }
    }

    /// The parameters being read.
    #[must_use]
    pub fn parameters(&self) -> &'a NodeParameters {
        self.parameters
    }

    /// Reads inside a group: keys in `read` are relative to it.
    pub fn group<T>(&mut self, name: &str, read: impl FnOnce(&mut Self) -> T) -> T {
        let length = self.prefix.len();
        self.prefix.push_str(name);
        self.prefix.push('.');
        let value = read(self);
        self.prefix.truncate(length);
        value
    }

    /// Marks the parameters that `read` reads as not settable while the node runs.
    pub fn fixed<T>(&mut self, read: impl FnOnce(&mut Self) -> T) -> T {
        let before = std::mem::replace(&mut self.read_only, true);
        let value = read(self);
        self.read_only = before;
        value
    }

    /// Names below a key, in file order: `children("jets")`; of the open group itself below `""`.
    #[must_use]
    pub fn children(&self, key: &str) -> Vec<String> {
        self.named.borrow_mut().insert(self.full(key).trim_end_matches('.').to_owned());
        self.parameters
            .children(self.full(key).trim_end_matches('.'))
            .into_iter()
            .map(str::to_owned)
            .collect()
    }

    /// True when a value, or a group with at least one value, is set under this key.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        let full = self.full(key);
        let set = |full: &str| self.parameters.get(full).is_some() || self.parameters.has_children(full);
        set(&full) || self.overlaid(&full).is_some_and(|key| set(&key))
    }

    /// Reports a parameter that is invalid in a way that its range cannot express, such as a minimum
    /// above its maximum. `problem` says what is wrong and what is allowed.
    pub fn reject(&mut self, key: &str, problem: impl Into<String>) {
        let full = self.full(key);
        let error = match self.entry(&full) {
            Some(entry) => ParameterError::new(entry.origin.clone(), problem)
                .with_key(entry.key.clone())
                .with_value(entry.value.to_string()),
            None => {
                // A group: point at its first key.
                let overlaid = self.overlaid(&full).filter(|group| self.first_below(group).is_some());
                let group = overlaid.unwrap_or(full);
                let origin = self.first_below(&group).map(|entry| entry.origin.clone());
                ParameterError::new(origin.unwrap_or_else(|| self.parameters.node_origin()), problem)
                    .with_key(group)
            }
        };
        self.errors.push(error);
    }

    /// As [`Self::reject`] for a whole group; its keys are then not reported as unknown.
    pub fn reject_group(&mut self, key: &str, problem: impl Into<String>) {
        let full = self.full(key);
        for group in self.overlaid(&full).into_iter().chain([full]) {
            let dot = format!("{group}.");
            let below =
                self.parameters.iter().filter(|entry| entry.key == group || entry.key.starts_with(&dot));
            self.known.extend(below.map(|entry| entry.key.clone()));
        }
        self.reject(key, problem);
    }

    /// Leaves the open group at that: what stands below it and was not read is not reported as unknown. For a group whose
    /// own kind is wrong, which has been reported.
    pub fn leave_group(&mut self) {
        let below = self.parameters.iter().filter(|entry| entry.key.starts_with(&self.prefix));
        self.known.extend(below.map(|entry| entry.key.clone()));
    }

    /// How many errors were found so far.
    #[must_use]
    pub fn error_count(&self) -> usize {
        self.errors.len()
    }

    /// Requires that this node knows every key below a shared group.
    pub fn claim_group(&mut self, group: &str) {
        self.claimed.push(format!("{group}."));
    }

    /// Everything that was asked for, whatever is wrong with the answers, and the groups whose members the user names.
    pub(crate) fn into_asked(self) -> (Vec<Descriptor>, BTreeSet<String>) {
        (self.descriptors, self.named.into_inner())
    }

    /// Ends reading: all descriptors, or all errors, unknown keys included. Of a group of which nothing was asked nothing is
    /// said beside an error: what was refused may be what it depends on.
    ///
    /// # Errors
    /// Everything that was wrong.
    pub fn finish(mut self) -> Result<Vec<Descriptor>, ParameterErrors> {
        let mut unknown = Vec::new();
        for entry in self.parameters.iter() {
            let ignored = entry.key == "use_sim_time"
                || is_shared(&entry.key)
                    && !self.claimed.iter().any(|group| entry.key.starts_with(group.as_str()));
            let unasked = !self.errors.is_empty() && !self.has_asked_beside(&entry.key);
            if ignored || unasked || self.known.contains(&entry.key) {
                continue;
            }
            let hint = nearest(&entry.key, self.known.iter().map(String::as_str))
                .map_or_else(|| self.siblings(&entry.key), |key| format!("did you mean {key}?"));
            unknown.push(
                ParameterError::new(
                    entry.origin.clone(),
                    format!("unknown parameter of {}; {hint}", self.parameters.node()),
                )
                .with_key(entry.key.clone())
                .with_value(entry.value.to_string()),
            );
        }
        self.errors.append(&mut unknown);
        ParameterErrors::check(self.errors)?;
        Ok(self.descriptors)
    }

    /// Whether anything was asked of the group that a key stands in, be it itself as a value.
    fn has_asked_beside(&self, key: &str) -> bool {
        let Some((group, _)) = key.rsplit_once('.') else { return true };
        self.known.contains(group) || self.known_below(group).next().is_some()
    }

    /// Known keys of the group that a key stands in.
    fn siblings(&self, key: &str) -> String {
        let mut group = key;
        loop {
            group = group.rsplit_once('.').map_or("", |(group, _)| group);
            let dot = if group.is_empty() { String::new() } else { format!("{group}.") };
            let mut names: Vec<&str> = self
                .known
                .iter()
                .filter_map(|known| known.strip_prefix(dot.as_str()))
                .map(|rest| rest.split_once('.').map_or(rest, |(name, _)| name))
                .collect();
            names.dedup();
            if !names.is_empty() {
                return format!("known here: {}", names.join(", "));
            }
            if group.is_empty() {
                return "this node has no parameters".into();
            }
        }
    }

    /// Reads with some keys overlaid: below `from`, a key that is also set below `to` takes its
    /// value from there.
    pub(crate) fn overlay<T>(&mut self, from: &str, to: &str, read: impl FnOnce(&mut Self) -> T) -> T {
        let before = self.overlay.replace((format!("{from}."), format!("{to}.")));
        let value = read(self);
        self.overlay = before;
        value
    }

    /// As [`Self::group`], of a group that is never mixed: where the overlay has any of it, all of it is read there, and
    /// `read` is told so.
    pub(crate) fn whole_group<T>(&mut self, name: &str, read: impl FnOnce(&mut Self, bool) -> T) -> T {
        let overlaid = self.overlaid(&self.full(name));
        let Some(group) = overlaid.filter(|group| self.parameters.has_children(group)) else {
            return self.group(name, |r| read(r, false));
        };
        let prefix = std::mem::replace(&mut self.prefix, format!("{group}."));
        let overlay = self.overlay.take();
        let value = read(self, true);
        (self.prefix, self.overlay) = (prefix, overlay);
        value
    }

    /// Keys below a group that were read so far, relative to it.
    pub(crate) fn known_below(&self, group: &str) -> impl Iterator<Item = &str> + Clone {
        let dot = format!("{group}.");
        let below = self.known.range(dot.clone()..).take_while({
            let dot = dot.clone();
            move |key| key.starts_with(&dot)
        });
        let length = dot.len();
        below.filter_map(move |key| key.get(length..))
    }

    pub(crate) fn full(&self, key: &str) -> String {
        format!("{}{key}", self.prefix)
    }

    fn overlaid(&self, full: &str) -> Option<String> {
        let (from, to) = self.overlay.as_ref()?;
        full.strip_prefix(from.as_str()).map(|rest| format!("{to}{rest}"))
    }

    /// The entry in force for a full key.
    fn entry(&self, full: &str) -> Option<&'a Entry> {
        self.overlaid(full).and_then(|key| self.parameters.get(&key)).or_else(|| self.parameters.get(full))
    }

    /// The first entry below a full key.
    fn first_below(&self, full: &str) -> Option<&'a Entry> {
        let dot = format!("{full}.");
        self.parameters.iter().find(|entry| entry.key.starts_with(&dot))
    }

    /// The heart of every read. `accept` checks the value, already of the requested type where
    /// that is possible, and returns it in its Rust form; `Err` explains beyond "allowed".
    pub(crate) fn request<T>(
        &mut self,
        request: Request<'_>,
        absent: Absent,
        accept: impl FnOnce(&Value) -> Option<T>,
    ) -> Option<T> {
        let full = self.full(request.key);
        if let Some(overlaid) = self.overlaid(&full) {
            self.known.insert(overlaid);
        }
        self.known.insert(full.clone());
        let entry = self.entry(&full);
        let required = matches!(absent, Absent::Refuse);
        let default = if let Absent::Default(value) = &absent { Some(value.clone()) } else { None };
        let default = default.map(|value| value.converted(request.kind).unwrap_or(value));
        let (value, origin) = match (entry, absent) {
            (Some(entry), _) => (Some(entry.value.clone()), Some(&entry.origin)),
            (None, Absent::Default(value)) => (Some(value), None),
            (None, Absent::Leave) => (None, None),
            (None, Absent::Refuse) => {
                let error = ParameterError::new(
                    self.parameters.node_origin(),
                    format!("missing; needed: {} ({}); {}", request.allowed, request.doc, self.searched()),
                );
                self.errors.push(error.with_key(full.clone()));
                (None, None)
            }
        };
        let value = value.map(|value| value.converted(request.kind).unwrap_or(value));
        let name = entry.map_or_else(|| full.clone(), |entry| entry.key.clone());
        let result = match &value {
            None => None,
            Some(value) => {
                let accepted = accept(value);
                if accepted.is_none() {
                    let origin = origin.cloned().unwrap_or_else(|| self.parameters.node_origin());
                    let choices = request.choices.iter().map(String::as_str);
                    let hint = match value {
                        Value::String(word) => nearest(word, choices),
                        _ => None,
                    };
                    let hint = hint.map_or_else(String::new, |choice| format!("; did you mean {choice}?"));
                    self.errors.push(
                        ParameterError::new(
                            origin,
                            format!("allowed: {} ({}){hint}", request.allowed, request.doc),
                        )
                        .with_key(name.clone())
                        .with_value(value.to_string()),
                    );
                }
                accepted
            }
        };
        self.describe(Descriptor {
            read_only: self.read_only || is_shared(&name),
            name,
            kind: value.as_ref().map_or(request.kind, Value::kind),
            value,
            default,
            required,
            doc: request.doc.to_owned(),
            allowed: request.allowed,
            range: request.range,
            choices: request.choices,
        });
        result
    }

    fn describe(&mut self, descriptor: Descriptor) {
        if !self.described.contains_key(&descriptor.name) {
            self.described.insert(descriptor.name.clone(), self.descriptors.len());
            self.descriptors.push(descriptor);
        }
    }

    fn searched(&self) -> String {
        match self.parameters.files() {
            [] => "no parameter file was given".into(),
            files => format!("looked in {}", files.join(", ")),
        }
    }
}

/// Reads a node's parameters with `read`, its single definition of them.
///
/// # Errors
/// Everything that was wrong, unknown keys included.
pub fn read<T>(
    parameters: &NodeParameters,
    read: impl FnOnce(&mut Reader<'_>) -> T,
) -> Result<(T, Vec<Descriptor>), ParameterErrors> {
    let mut reader = Reader::new(parameters);
    let value = read(&mut reader);
    reader.finish().map(|descriptors| (value, descriptors))
}

/// Reads shared groups only ([`crate::SHARED_GROUPS`]): keys of the node itself are neither read nor
/// refused. For callers that need the formation or a model but are not the node.
///
/// # Errors
/// Everything that was wrong with these groups.
pub fn read_shared<T>(
    parameters: &NodeParameters,
    read: impl FnOnce(&mut Reader<'_>) -> T,
) -> Result<T, ParameterErrors> {
    self::read(&parameters.only_shared(), read).map(|(value, _)| value)
}

/// As [`read()`], for a `read` that gives `None` when it has met an error.
///
/// # Errors
/// Everything that was wrong, unknown keys included.
pub fn try_read<T>(
    parameters: &NodeParameters,
    read: impl FnOnce(&mut Reader<'_>) -> Option<T>,
) -> Result<(T, Vec<Descriptor>), ParameterErrors> {
    let (value, descriptors) = self::read(parameters, read)?;
    match value {
        Some(value) => Ok((value, descriptors)),
        None => Err(ParameterError::new(parameters.node_origin(), "its parameters are incomplete").into()),
    }
}
