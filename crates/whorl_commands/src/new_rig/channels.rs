//! The map that is drafted: of the columns of a CSV file, or of the topics of a bag.

use whorl_bag::Channel;

use super::lines::{Lines, Sourced, quoted};

/// What a map says of one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Its key.
    pub key: String,
    /// The channel.
    pub channel: Channel,
    /// Columns in their order, each perhaps with a minus in front, `~` where there is none; or the topic alone.
    pub columns: Vec<String>,
    /// Why these.
    pub of: Sourced<()>,
    /// The unit as maps write it, if it has one.
    pub unit: Option<Sourced<String>>,
    /// What else the map says in the group, as YAML.
    pub more: Vec<String>,
}

/// The draft.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapDraft {
    /// Of a bag; else of a CSV file.
    pub is_bag: bool,
    /// The group `time` of a CSV file, as YAML.
    pub time: Option<Sourced<String>>,
    /// Separator and decimals, as YAML.
    pub form: Vec<Sourced<String>>,
    /// The channels.
    pub entries: Vec<Entry>,
    /// Columns or topics that nobody knows what to do with.
    pub ignored: Vec<String>,
    /// What is to be said.
    pub notes: Vec<String>,
}

impl MapDraft {
    /// The entry of a channel.
    #[must_use]
    pub fn entry(&self, channel: Channel) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.channel == channel)
    }

    /// The same, to be changed.
    pub fn entry_mut(&mut self, channel: Channel) -> Option<&mut Entry> {
        self.entries.iter_mut().find(|entry| entry.channel == channel)
    }

    /// The lines of the map of a platform.
    #[must_use]
    pub fn lines(&self, platform: &str) -> Lines {
        let mut lines = Lines::default();
        lines.open(0, if self.is_bag { "bag:" } else { "csv:" });
        lines.open(1, "ros__parameters:");
        if self.is_bag {
            lines.open(2, format!("platform: {platform}"));
        }
        for said in self.time.iter().chain(&self.form) {
            lines.add(2, said.value.clone(), said.origin, said.words.clone());
        }
        for entry in &self.entries {
            let mut parts = Vec::new();
            let names: Vec<String> = entry
                .columns
                .iter()
                .map(|name| if name == "~" { name.clone() } else { quoted(name) })
                .collect();
            let is_single = Self::is_single(entry.channel) || entry.key == "hinge_angle";
            parts.push(match (self.is_bag, is_single) {
                (true, _) => format!("topic: {}", entry.columns.concat()),
                (false, true) => format!("column: {}", names.concat()),
                (false, false) => format!("columns: [{}]", names.join(", ")),
            });
            parts.extend(entry.unit.iter().map(|unit| format!("unit: {}", quoted_unit(&unit.value))));
            parts.extend(entry.more.iter().cloned());
            // The unit is what is wrong most often: its source stands there where there is one.
            let (origin, words) = match &entry.unit {
                Some(unit) => (unit.origin, unit.words.clone()),
                None => (entry.of.origin, entry.of.words.clone()),
            };
            let words = match (&entry.unit, entry.of.words.as_str()) {
                (Some(_), also) if !also.is_empty() => format!("{words}; {also}"),
                _ => words,
            };
            lines.add(2, format!("{}: {{{}}}", entry.key, parts.join(", ")), origin, words);
        }
        lines
    }

    fn is_single(channel: Channel) -> bool {
        channel.info().form == whorl_bag::Form::Scalar
    }
}

fn quoted_unit(unit: &str) -> String {
    if unit == "%" { "\"%\"".to_owned() } else { unit.to_owned() }
}
