//! Reading a run directory.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};
use whorl_msgs::Topic;

use crate::layout::BAG_DIRECTORY;
use crate::manifest::{MANIFEST_FILE, Manifest, RunDescription, RunState};
use crate::statistics::{TopicStatistics, expected_rate_hz};
use crate::summary::{manifest_summary, read_summary, update_summary};
use crate::{BagError, BagReader, BagTopic, METADATA_FILE, Recovery, recover};

/// A run directory, or a plain bag taken for one.
#[derive(Debug, Clone, PartialEq)]
pub struct RunDirectory {
    path: PathBuf,
    bag: PathBuf,
    manifest: Option<Manifest>,
}

impl RunDirectory {
    /// Opens a run directory, a rosbag2 directory or an `.mcap` file. Nothing is changed; see
    /// [`Self::recover`] for runs whose recorder was killed.
    ///
    /// # Errors
    /// [`BagError::NotFound`], [`BagError::NotABag`], [`BagError::Metadata`].
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let kind = std::fs::metadata(path).map_err(|e| BagError::io("cannot open", path, e))?;
        let inner = path.join(BAG_DIRECTORY);
        if kind.is_dir() && (path.join(MANIFEST_FILE).exists() || inner.is_dir()) {
            let manifest = match Manifest::read(path) {
                Ok(manifest) => Some(manifest),
                Err(BagError::NotFound { .. }) => None,
                Err(error) => return Err(error),
            };
            return Ok(Self { path: path.to_owned(), bag: inner, manifest });
        }
        if kind.is_dir() && !path.join(METADATA_FILE).exists() {
            crate::metadata::mcap_files(path)?;
        }
        Ok(Self { path: path.to_owned(), bag: path.to_owned(), manifest: None })
    }

    /// The directory (or file) that was opened.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The manifest; `None` for a plain bag.
    #[must_use]
    pub fn manifest(&self) -> Option<&Manifest> {
        self.manifest.as_ref()
    }

    /// Opens the bag.
    ///
    /// # Errors
    /// As [`BagReader::open`].
    pub fn bag(&self) -> Result<BagReader, BagError> {
        BagReader::open(&self.bag)
    }

    /// The names of the platforms: from the manifest, or else from the topics of the bag, by name.
    ///
    /// # Errors
    /// As [`BagReader::open`].
    pub fn platforms(&self) -> Result<Vec<String>, BagError> {
        match &self.manifest {
            Some(manifest) if !manifest.description.platforms.is_empty() => {
                Ok(manifest.description.platforms.clone())
            }
            _ => Ok(platforms_of(&self.bag()?)),
        }
    }

    /// The copies of the parameter files, in the order in which they were given. Empty for a plain bag. Files of effects,
    /// in a folder `effects` of their own, are none.
    #[must_use]
    pub fn parameter_files(&self) -> Vec<PathBuf> {
        let files = self.manifest.iter().flat_map(|manifest| &manifest.parameters);
        let is_effect = |path: &PathBuf| path.parent().is_some_and(|folder| folder.ends_with("effects"));
        files.map(|file| self.path.join(&file.file)).filter(|path| !is_effect(path)).collect()
    }

    /// `summary.json`; empty when there is none.
    ///
    /// # Errors
    /// [`BagError::Metadata`] when it is not a JSON object.
    pub fn summary(&self) -> Result<Map<String, Value>, BagError> {
        read_summary(&self.path)
    }

    /// Sets entries of `summary.json` and keeps the others.
    ///
    /// # Errors
    /// As [`Self::summary`]; [`BagError::Io`].
    pub fn update_summary(&self, entries: &Map<String, Value>) -> Result<(), BagError> {
        update_summary(&self.path, entries)
    }

    /// Makes a run complete whose recorder was killed: bag (see [`recover`]), manifest and summary. Does
    /// nothing to a complete one.
    ///
    /// # Errors
    /// [`BagError::InUse`] while it is being recorded; as [`recover`].
    pub fn recover(&mut self) -> Result<Recovery, BagError> {
        if self.bag.is_file() {
            return Ok(Recovery::default());
        }
        // Of a run out of an archive it may lead anywhere.
        if self.bag != self.path && self.bag.is_symlink() {
            let why =
                std::io::Error::other("it is a link: only a recording in its own run directory is repaired");
            return Err(BagError::io("cannot repair", &self.bag, why));
        }
        let recovery = recover(&self.bag)?;
        let Some(mut manifest) = self.manifest.take() else { return Ok(recovery) };
        if manifest.state == RunState::Recording {
            let reader = self.bag()?;
            complete_from_bag(&mut manifest, &reader)?;
            manifest.write(&self.path)?;
            update_summary(&self.path, &manifest_summary(&manifest))?;
        }
        self.manifest = Some(manifest);
        Ok(recovery)
    }

    /// The manifest that fits the bag: the one that was recorded if it is final, or one made from the bag's
    /// messages. Changes no file.
    ///
    /// # Errors
    /// As [`BagReader::open`], or a damaged bag.
    pub fn manifest_or_from_bag(&self) -> Result<Manifest, BagError> {
        match &self.manifest {
            Some(manifest) if manifest.state != RunState::Recording => Ok(manifest.clone()),
            other => {
                let reader = self.bag()?;
                let mut manifest = other.clone().unwrap_or_else(|| Manifest {
                    description: RunDescription {
                        platforms: platforms_of(&reader),
                        ..RunDescription::default()
                    },
                    ..Manifest::default()
                });
                complete_from_bag(&mut manifest, &reader)?;
                Ok(manifest)
            }
        }
    }
}

/// Makes the runs in a directory complete whose recorder was killed, see [`RunDirectory::recover`]. Tells what
/// was done to which; complete runs, and those being recorded at this moment, are passed over.
#[must_use]
pub fn recover_runs(directory: &Path) -> Vec<(PathBuf, Result<Recovery, BagError>)> {
    let Ok(entries) = std::fs::read_dir(directory) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    let recover = |path: PathBuf| {
        let mut run = RunDirectory::open(&path).ok()?;
        if run.manifest()?.state != RunState::Recording {
            return None;
        }
        match run.recover() {
            Err(BagError::InUse { .. }) => None,
            result => Some((path, result)),
        }
    };
    paths.into_iter().filter_map(recover).collect()
}

fn platforms_of(reader: &BagReader) -> Vec<String> {
    let names = reader.topics().iter().filter_map(|topic| topic.whorl_topic()?.0.map(str::to_owned));
    names.collect::<std::collections::BTreeSet<_>>().into_iter().collect()
}

/// Fills in what the recorder would have written at its end.
fn complete_from_bag(manifest: &mut Manifest, reader: &BagReader) -> Result<(), BagError> {
    let mut statistics: Vec<(&BagTopic, bool, TopicStatistics)> = reader
        .topics()
        .iter()
        .map(|topic| {
            let known = topic.whorl_topic().map(|(_, topic)| topic);
            // Topics with one writer: the numbers in the bag do not say whose they are.
            let single = known.is_some_and(|topic| !matches!(topic, Topic::Diagnostics | Topic::Tf));
            (topic.as_ref(), single, TopicStatistics::new(known.and_then(expected_rate_hz)))
        })
        .collect();
    for message in reader.messages() {
        let message = message?;
        if let Some((_, single, entry)) = statistics.iter_mut().find(|(t, ..)| t.name == message.topic.name) {
            entry.observe(message.log_time, message.cdr.len());
            if *single {
                entry.observe_sequence_32(0, message.sequence);
            }
        }
    }
    manifest.state = RunState::Recovered;
    manifest.bounds = reader.bounds();
    manifest.topics = statistics.iter().map(|(t, _, s)| s.summary(&t.name, &t.type_name)).collect();
    manifest.bag_bytes = reader.bytes();
    Ok(())
}
