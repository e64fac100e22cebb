//! A law's settings, from a parameter file.

use nalgebra::{Unit, Vector3};
use whorl_control::formation::{Allowed, Settings};
use whorl_params::{Limits, Reader, range};

use super::super::refusals;

/// The reader, as laws see it.
pub(super) struct ReaderSettings<'s, 'r> {
    reader: &'s mut Reader<'r>,
    platforms: &'s [String],
    /// Names of the open groups.
    groups: Vec<String>,
}

impl<'s, 'r> ReaderSettings<'s, 'r> {
    /// Keys are relative to the reader's open group.
    pub fn new(reader: &'s mut Reader<'r>, platforms: &'s [String]) -> Self {
        Self { reader, platforms, groups: Vec::new() }
    }

    fn full(&self, key: &str) -> String {
        self.groups.iter().map(String::as_str).chain([key]).collect::<Vec<_>>().join(".")
    }

    /// The index of a platform; `None` after an error.
    fn index(&mut self, key: &str, name: &str) -> Option<usize> {
        let found = self.platforms.iter().position(|platform| platform == name);
        if found.is_none() {
            let allowed = self.platforms.join(", ");
            self.reader.reject(key, format!("`{name}` is no platform; allowed: {allowed}"));
        }
        found
    }
}

fn limits(allowed: Allowed) -> Limits<f64> {
    let limits = range((allowed.lower, allowed.upper));
    if allowed.or_infinite { limits.or_not_finite() } else { limits }
}

impl Settings for ReaderSettings<'_, '_> {
    fn enter(&mut self, group: &str) {
        self.groups.push(group.to_owned());
    }

    fn leave(&mut self) {
        self.groups.pop();
    }

    fn has(&self, key: &str) -> bool {
        self.reader.has(&self.full(key))
    }

    fn number(&mut self, key: &str, allowed: Allowed, doc: &str) -> f64 {
        self.reader.f64(&self.full(key), limits(allowed), doc)
    }

    fn number_or(&mut self, key: &str, default: f64, allowed: Allowed, doc: &str) -> f64 {
        self.reader.f64_or(&self.full(key), default, limits(allowed), doc)
    }

    fn direction(&mut self, key: &str, doc: &str) -> Unit<Vector3<f64>> {
        self.reader.direction(&self.full(key), doc)
    }

    fn platform_or(&mut self, key: &str, default: Option<usize>, doc: &str) -> Option<usize> {
        let full = self.full(key);
        let default = default.and_then(|index| self.platforms.get(index)).map_or("", String::as_str);
        let name = self.reader.string_or(&full, default, doc);
        if name.is_empty() { None } else { self.index(&full, &name) }
    }

    fn optional_platforms(&mut self, key: &str, doc: &str) -> Option<Vec<usize>> {
        let full = self.full(key);
        let names = self.reader.optional_string_array(&full, doc)?;
        Some(names.iter().filter_map(|name| self.index(&full, name)).collect())
    }

    fn reject(&mut self, key: &str, problem: String) {
        let full = self.full(key);
        self.reader.reject(&full, refusals::with_names(&problem, self.platforms));
    }
}
