//! `manifest.yaml`: what was run, with what, and what was recorded.

use std::path::{Component, Path};

use saphyr::Yaml;
use whorl_math::words::one_line;
use whorl_node::Timestamp;

use crate::metadata::replace_file;
use crate::utc::utc;
use crate::yaml::{self, YamlWriter};
use crate::{BagError, SequenceCounts, TopicSummary};

/// Name of the manifest in a run directory.
pub const MANIFEST_FILE: &str = "manifest.yaml";

/// How far a recording got.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum RunState {
    /// It is being recorded, or its recorder was killed.
    #[default]
    Recording,
    /// It ended normally.
    Complete,
    /// It ended early, and why.
    Stopped(String),
    /// Its recorder was killed; the bag was made complete afterwards.
    Recovered,
}

impl RunState {
    /// The word in the file.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Complete => "complete",
            Self::Stopped(_) => "stopped",
            Self::Recovered => "recovered",
        }
    }
}

/// A parameter file of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParameterFile {
    /// The copy, relative to the run directory.
    pub file: String,
    /// Where it was taken from.
    pub source: String,
    /// SHA-256 of its content, hexadecimal.
    pub sha256: String,
}

/// Information about a run that is known at its start.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RunDescription {
    /// Name of the experiment.
    pub experiment: String,
    /// Version of Whorl.
    pub version: String,
    /// Commit it was built from, if known.
    pub git_commit: Option<String>,
    /// Seed of all randomness, for simulated runs.
    pub seed: Option<u64>,
    /// Whether times count from the start of a simulation and not from 1970.
    pub simulated_time: bool,
    /// Names of the platforms in the order of their numbers.
    pub platforms: Vec<String>,
    /// Further facts, e.g. the modelled delay of a link.
    pub notes: Vec<(String, String)>,
}

impl RunDescription {
    /// The note on a run whose traffic was secured.
    #[must_use]
    pub fn secured_note() -> (String, String) {
        ("traffic".to_owned(), "secured".to_owned())
    }

    /// Whether its traffic was secured.
    #[must_use]
    pub fn is_secured(&self) -> bool {
        self.notes.contains(&Self::secured_note())
    }
}

/// The manifest of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Manifest {
    /// What was run.
    pub description: RunDescription,
    /// How far it got.
    pub state: RunState,
    /// When recording began \[UTC\].
    pub start_utc: Timestamp,
    /// When recording ended \[UTC\]; `None` while it goes on, and when the recorder was killed.
    pub stop_utc: Option<Timestamp>,
    /// Log times of the first and last message.
    pub bounds: Option<(Timestamp, Timestamp)>,
    /// Bytes of the bag.
    pub bag_bytes: u64,
    /// The parameter files in use.
    pub parameters: Vec<ParameterFile>,
    /// The topics.
    pub topics: Vec<TopicSummary>,
}

impl Manifest {
    /// Messages of all topics.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.count).sum()
    }

    /// Losses of all topics.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.topics.iter().filter_map(|topic| topic.sequence).map(|counts| counts.lost).sum()
    }

    /// From the first to the last message \[s\].
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.bounds.map_or(0.0, |(first, last)| last.seconds_since(first))
    }

    /// The topic with this name.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicSummary> {
        self.topics.iter().find(|topic| topic.name == name)
    }

    /// The file's text.
    #[must_use]
    pub fn to_yaml(&self) -> String {
        let mut y = YamlWriter::default();
        let d = &self.description;
        y.raw("format", 1);
        y.text("experiment", &d.experiment);
        y.text("state", self.state.name());
        if let RunState::Stopped(reason) = &self.state {
            y.text("stopped_because", reason);
        }
        y.text("version", &d.version);
        y.raw("git_commit", d.git_commit.as_deref().map_or("~".into(), yaml::quoted));
        y.raw("seed", d.seed.map_or("~".into(), |seed| seed.to_string()));
        y.raw("simulated_time", d.simulated_time);
        y.text("start_utc", &utc(self.start_utc));
        y.raw("start_utc_ns", self.start_utc.0);
        y.raw("stop_utc", self.stop_utc.map_or("~".into(), |time| yaml::quoted(&utc(time))));
        y.raw("stop_utc_ns", self.stop_utc.map_or("~".into(), |time| time.0.to_string()));
        y.number("duration_s", self.duration_s());
        let bound = |time: Option<Timestamp>| time.map_or("~".into(), |t| t.0.to_string());
        y.raw("first_log_time_ns", bound(self.bounds.map(|b| b.0)));
        y.raw("last_log_time_ns", bound(self.bounds.map(|b| b.1)));
        y.raw("messages", self.message_count());
        y.raw("lost", self.lost());
        y.raw("bag_bytes", self.bag_bytes);
        y.scalars("platforms", &d.platforms);
        y.list("parameters", &self.parameters, |y, file| {
            y.text("file", &file.file);
            y.text("source", &file.source);
            y.text("sha256", &file.sha256);
        });
        y.list("notes", &d.notes, |y, (key, value)| {
            y.text("key", key);
            y.text("value", value);
        });
        y.list("topics", &self.topics, topic_to_yaml);
        y.finish()
    }

    /// Reads the file's text; `path` is for messages.
    ///
    /// # Errors
    /// [`BagError::Metadata`] with what is missing or wrong.
    pub fn from_yaml(path: &Path, text: &str) -> Result<Self, BagError> {
        let root = yaml::load(path, text)?;
        let node = Node { path, node: &root };
        let reason = node.text("stopped_because").unwrap_or_default();
        Ok(Self {
            state: match node.text("state")?.as_str() {
                "complete" => RunState::Complete,
                "stopped" => RunState::Stopped(reason),
                "recovered" => RunState::Recovered,
                "recording" => RunState::Recording,
                other => return Err(node.wrong("state", &format!("`{other}` is not a state"))),
            },
            start_utc: Timestamp(node.integer("start_utc_ns")?),
            stop_utc: node.integer("stop_utc_ns").ok().map(Timestamp),
            bounds: node
                .integer("first_log_time_ns")
                .and_then(|first| Ok((Timestamp(first), Timestamp(node.integer("last_log_time_ns")?))))
                .ok(),
            bag_bytes: node.count("bag_bytes")?,
            parameters: node.list("parameters", |file| {
                let name = file.text("file")?;
                // Of a run that somebody else made it may lead anywhere.
                let is_inside =
                    |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
                if !Path::new(&name).components().all(is_inside) {
                    return Err(file.wrong("file", "it leads out of the run directory"));
                }
                Ok(ParameterFile { file: name, source: file.text("source")?, sha256: file.text("sha256")? })
            })?,
            topics: node.list("topics", topic_from_yaml)?,
            description: RunDescription {
                experiment: node.text("experiment")?,
                version: node.text("version")?,
                git_commit: node.text("git_commit").ok(),
                seed: node.count("seed").ok(),
                simulated_time: node.boolean("simulated_time")?,
                platforms: node.list("platforms", |name| {
                    name.node.as_str().map(str::to_owned).ok_or_else(|| name.wrong("platforms", "not a name"))
                })?,
                notes: node.list("notes", |note| Ok((note.text("key")?, note.text("value")?)))?,
            },
        })
    }

    /// Reads `manifest.yaml` in a run directory.
    ///
    /// # Errors
    /// [`BagError::NotFound`]; as [`Self::from_yaml`].
    pub fn read(run: &Path) -> Result<Self, BagError> {
        let path = run.join(MANIFEST_FILE);
        let text = whorl_files::read_text(&path).map_err(|e| BagError::io("cannot read", &path, e))?;
        Self::from_yaml(&path, &text)
    }

    pub(crate) fn write(&self, run: &Path) -> Result<(), BagError> {
        replace_file(&run.join(MANIFEST_FILE), self.to_yaml().as_bytes())
    }
}

fn topic_to_yaml(y: &mut YamlWriter, topic: &TopicSummary) {
    y.text("name", &topic.name);
    y.text("type", &topic.type_name);
    y.raw("count", topic.count);
    y.raw("bytes", topic.bytes);
    y.number("rate_hz", topic.rate_hz);
    y.raw("expected_rate_hz", topic.expected_rate_hz.map_or("~".into(), yaml::number));
    y.raw("gaps", topic.gaps);
    y.number("largest_gap_s", topic.largest_gap_s);
    y.number("largest_gap_at_s", topic.largest_gap_at_s);
    y.raw("writers", topic.writers);
    match topic.sequence {
        None => y.raw("sequence", "~"),
        Some(counts) => y.group("sequence", |y| {
            y.raw("received", counts.received);
            y.raw("lost", counts.lost);
            y.raw("late", counts.late);
            y.raw("duplicates", counts.duplicates);
            y.raw("restarts", counts.restarts);
        }),
    }
}

fn topic_from_yaml(node: &Node<'_, '_>) -> Result<TopicSummary, BagError> {
    let sequence = yaml::find(node.node, &["sequence"]).filter(|s| s.is_mapping());
    let sequence = sequence.map(|s| Node { path: node.path, node: s });
    Ok(TopicSummary {
        name: node.text("name")?,
        type_name: node.text("type")?,
        count: node.count("count")?,
        bytes: node.count("bytes")?,
        rate_hz: node.number("rate_hz")?,
        expected_rate_hz: node.number("expected_rate_hz").ok(),
        largest_gap_s: node.number("largest_gap_s")?,
        largest_gap_at_s: node.number("largest_gap_at_s")?,
        gaps: node.count("gaps")?,
        writers: node.count("writers")?,
        sequence: match sequence {
            None => None,
            Some(s) => Some(SequenceCounts {
                received: s.count("received")?,
                lost: s.count("lost")?,
                late: s.count("late")?,
                duplicates: s.count("duplicates")?,
                restarts: s.count("restarts")?,
            }),
        },
    })
}

/// A mapping with the file it came from.
struct Node<'a, 'input> {
    path: &'a Path,
    node: &'a Yaml<'input>,
}

impl Node<'_, '_> {
    fn wrong(&self, key: &str, what: &str) -> BagError {
        BagError::Metadata { path: self.path.to_owned(), reason: format!("`{key}`: {what}") }
    }

    fn get<T>(
        &self,
        key: &str,
        what: &str,
        read: impl FnOnce(&Yaml<'_>) -> Option<T>,
    ) -> Result<T, BagError> {
        yaml::find(self.node, &[key]).and_then(read).ok_or_else(|| self.wrong(key, what))
    }

    fn text(&self, key: &str) -> Result<String, BagError> {
        self.get(key, "a text is missing", |v| v.as_str().map(|text| one_line(text).into_owned()))
    }

    fn integer(&self, key: &str) -> Result<i64, BagError> {
        self.get(key, "an integer is missing", |v| v.as_integer())
    }

    fn count(&self, key: &str) -> Result<u64, BagError> {
        self.get(key, "a count is missing", |v| u64::try_from(v.as_integer()?).ok())
    }

    fn number(&self, key: &str) -> Result<f64, BagError> {
        self.get(key, "a number is missing", |v| v.as_floating_point().or(v.as_integer().map(|i| i as f64)))
    }

    fn boolean(&self, key: &str) -> Result<bool, BagError> {
        self.get(key, "true or false is missing", |v| v.as_bool())
    }

    fn list<T>(
        &self,
        key: &str,
        read: impl Fn(&Node<'_, '_>) -> Result<T, BagError>,
    ) -> Result<Vec<T>, BagError> {
        let items = yaml::find(self.node, &[key]).and_then(|v| v.as_sequence());
        let items = items.ok_or_else(|| self.wrong(key, "a list is missing"))?;
        items.iter().map(|node| read(&Node { path: self.path, node })).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manifest_reads_back_as_written() {
        let topic = TopicSummary {
            name: "/whorl_1/imu/data_raw".into(),
            type_name: "sensor_msgs/msg/Imu".into(),
            count: 1000,
            bytes: 324_000,
            rate_hz: 99.9,
            expected_rate_hz: Some(100.0),
            largest_gap_s: 0.5,
            largest_gap_at_s: 3.25,
            gaps: 1,
            writers: 1,
            sequence: Some(SequenceCounts { received: 1000, lost: 49, late: 1, duplicates: 2, restarts: 3 }),
        };
        let full = Manifest {
            description: RunDescription {
                experiment: "leader: \"follower\"".into(),
                version: "0.1.0".into(),
                git_commit: Some("0123456".into()),
                seed: Some(7),
                simulated_time: true,
                platforms: vec!["whorl_1".into(), "whorl_2".into()],
                notes: vec![("link_delay_s".into(), "0.02".into())],
            },
            state: RunState::Stopped("no space left".into()),
            start_utc: Timestamp(1_700_000_000_123_456_789),
            stop_utc: Some(Timestamp(1_700_000_060_000_000_000)),
            bounds: Some((Timestamp(0), Timestamp(60_000_000_000))),
            bag_bytes: 12,
            parameters: vec![ParameterFile {
                file: "params/a.yaml".into(),
                source: "a.yaml".into(),
                sha256: "00".into(),
            }],
            topics: vec![topic.clone(), TopicSummary { sequence: None, expected_rate_hz: None, ..topic }],
        };
        let path = Path::new("manifest.yaml");
        assert_eq!(Manifest::from_yaml(path, &full.to_yaml()).unwrap(), full);
        assert_eq!((full.message_count(), full.lost()), (2000, 49));
        let empty = Manifest::default();
        assert_eq!(Manifest::from_yaml(path, &empty.to_yaml()).unwrap(), empty);
        let error =
            Manifest::from_yaml(path, &full.to_yaml().replace("count: 1000", "count: x")).unwrap_err();
        assert_eq!(error.to_string(), "manifest.yaml: `count`: a count is missing");
    }
}
