//! Writing a run directory.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use whorl_msgs::{Message, Route};
use whorl_node::Timestamp;

use crate::layout::{BAG_DIRECTORY, PARAMETER_DIRECTORY};
use crate::manifest::{MANIFEST_FILE, Manifest, ParameterFile, RunDescription, RunState};
use crate::metadata::replace_file;
use crate::statistics::{TopicStatistics, WriterId, expected_rate_hz};
use crate::summary::{manifest_summary, update_summary};
use crate::utc::utc;
use crate::{BagError, BagOptions, BagWriter, Sample, SequenceCounts, TopicHandle, offered_qos_profiles};

/// Writes `<UTC time>_<experiment>/` with `bag/`, `params/`, `manifest.yaml` and `summary.json`, and keeps
/// the counts for the manifest.
pub struct RunWriter {
    path: PathBuf,
    bag: BagWriter,
    manifest: Manifest,
    topics: Vec<RunTopic>,
    by_name: HashMap<String, usize>,
    by_route: HashMap<Route, usize>,
    stopped_by: Option<String>,
    encoded: Vec<u8>,
    /// Folder of the first parameter file.
    parameter_folder: Option<PathBuf>,
}

struct RunTopic {
    handle: TopicHandle,
    name: String,
    type_name: String,
    statistics: TopicStatistics,
}

/// A topic of a [`RunWriter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RunTopicHandle(usize);

/// A message as it came off the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RawSample<'a> {
    /// When it arrived.
    pub log_time: Timestamp,
    /// When it was sent; the log time if that is not known.
    pub publish_time: Timestamp,
    /// Its writer and the writer's sequence number, if known.
    pub origin: Option<(WriterId, u64)>,
    /// CDR with its 4-byte header.
    pub cdr: &'a [u8],
}

impl RunWriter {
    /// Creates the run directory below `parent` (which is created too), with a manifest that says that the
    /// recording goes on. A second run of the same name in the same second gets a number.
    ///
    /// # Errors
    /// [`BagError::Io`]; [`BagError::DiskFull`].
    pub fn create(
        parent: &Path,
        description: RunDescription,
        start_utc: Timestamp,
        options: BagOptions,
    ) -> Result<Self, BagError> {
        let path = new_run_directory(parent, &description.experiment, start_utc)?;
        Self::create_at(path, description, start_utc, options)
    }

    /// As [`Self::create`], in exactly this directory (created if need be). Other files may be in it, e.g.
    /// logs; a run may not.
    ///
    /// # Errors
    /// [`BagError::Exists`] when it holds a run; [`BagError::Io`]; [`BagError::DiskFull`].
    pub fn create_in(
        path: &Path,
        description: RunDescription,
        start_utc: Timestamp,
        options: BagOptions,
    ) -> Result<Self, BagError> {
        std::fs::create_dir_all(path).map_err(|e| BagError::io("cannot create", path, e))?;
        for part in [BAG_DIRECTORY, MANIFEST_FILE] {
            if path.join(part).exists() {
                return Err(BagError::Exists { path: path.join(part) });
            }
        }
        Self::create_at(path.to_owned(), description, start_utc, options)
    }

    fn create_at(
        path: PathBuf,
        description: RunDescription,
        start_utc: Timestamp,
        options: BagOptions,
    ) -> Result<Self, BagError> {
        let bag = BagWriter::create(&path.join(BAG_DIRECTORY), options)?;
        let parameters = path.join(PARAMETER_DIRECTORY);
        std::fs::create_dir_all(&parameters).map_err(|e| BagError::io("cannot create", &parameters, e))?;
        let manifest = Manifest { description, start_utc, ..Manifest::default() };
        manifest.write(&path)?;
        Ok(Self {
            path,
            bag,
            manifest,
            topics: Vec::new(),
            by_name: HashMap::new(),
            by_route: HashMap::new(),
            stopped_by: None,
            encoded: Vec::new(),
            parameter_folder: None,
        })
    }

    /// The run directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Copies a parameter file into `params/` and notes its hash. Files below the folder of the first one
    /// keep their place relative to it (`truth/whorl_1.yaml`), so that the copy can be used like the original;
    /// others are put beside the first. A second file of the same name gets a number in front.
    ///
    /// # Errors
    /// [`BagError::NotFound`], [`BagError::Io`].
    pub fn add_parameter_file(&mut self, source: &Path) -> Result<(), BagError> {
        let bytes = std::fs::read(source).map_err(|e| BagError::io("cannot read", source, e))?;
        let folder =
            self.parameter_folder.get_or_insert_with(|| source.parent().unwrap_or(Path::new("")).to_owned());
        let below = source.strip_prefix(folder).ok().filter(|below| is_plain(below));
        let name = below.or(source.file_name().map(Path::new)).unwrap_or(Path::new("parameters"));
        self.store_parameters(name, &source.to_string_lossy(), &bytes)
    }

    /// Copies the parameter files of a run, and the files of effects that belong to them.
    ///
    /// # Errors
    /// As [`Self::add_parameter_file`].
    pub fn add_parameter_files(&mut self, files: &[PathBuf]) -> Result<(), BagError> {
        for file in files {
            self.add_parameter_file(file)?;
        }
        for file in whorl_params::effect_files_beside(files) {
            self.add_effect_file(&file)?;
        }
        Ok(())
    }

    /// Copies the file of an effect into `params/effects/`, where the readers of the parameter files in `params/` look for
    /// it; that of a simulation's truth into `params/truth/effects/`.
    ///
    /// # Errors
    /// [`BagError::NotFound`], [`BagError::Io`].
    fn add_effect_file(&mut self, source: &Path) -> Result<(), BagError> {
        let bytes = std::fs::read(source).map_err(|e| BagError::io("cannot read", source, e))?;
        let name = source.file_name().map(Path::new).unwrap_or(Path::new("effect.yaml"));
        let is_of_truth =
            source.parent().and_then(Path::parent).is_some_and(|folder| folder.ends_with("truth"));
        let folder = Path::new(if is_of_truth { "truth/effects" } else { "effects" });
        self.store_parameters(&folder.join(name), &source.to_string_lossy(), &bytes)
    }

    /// Stores a parameter file from memory in `params/`, e.g. `effective.yaml`: the parameters as they were
    /// after all layers and overrides.
    ///
    /// # Errors
    /// [`BagError::Io`].
    pub fn add_parameters(&mut self, name: &str, source: &str, bytes: &[u8]) -> Result<(), BagError> {
        self.store_parameters(Path::new(name), source, bytes)
    }

    fn store_parameters(&mut self, name: &Path, source: &str, bytes: &[u8]) -> Result<(), BagError> {
        let directory = self.path.join(PARAMETER_DIRECTORY);
        let mut stored = name.to_owned();
        for number in 2.. {
            if !directory.join(&stored).exists() {
                break;
            }
            let plain = name.file_name().unwrap_or_default().to_string_lossy();
            stored = name.with_file_name(format!("{number}_{plain}"));
        }
        let path = directory.join(&stored);
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(|e| BagError::io("cannot create", parent, e))?;
        }
        replace_file(&path, bytes)?;
        self.manifest.parameters.push(ParameterFile {
            file: format!("{PARAMETER_DIRECTORY}/{}", stored.display()),
            source: source.to_owned(),
            sha256: hexadecimal(&Sha256::digest(bytes)),
        });
        self.manifest.write(&self.path)
    }

    /// Adds a fact to the manifest.
    pub fn note(&mut self, key: &str, value: impl Into<String>) {
        self.manifest.description.notes.push((key.to_owned(), value.into()));
    }

    /// Adds a topic by name, or finds it again. `expected_rate_hz` serves to tell gaps.
    ///
    /// # Errors
    /// [`BagError::TypeConflict`].
    pub fn add_topic(
        &mut self,
        name: &str,
        type_name: &str,
        offered_qos_profiles: &str,
        expected_rate_hz: Option<f64>,
    ) -> Result<RunTopicHandle, BagError> {
        let handle = self.bag.add_topic(name, type_name, offered_qos_profiles)?;
        if let Some(&index) = self.by_name.get(name) {
            return Ok(RunTopicHandle(index));
        }
        let index = self.topics.len();
        self.by_name.insert(name.to_owned(), index);
        self.topics.push(RunTopic {
            handle,
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            statistics: TopicStatistics::new(expected_rate_hz),
        });
        Ok(RunTopicHandle(index))
    }

    /// Adds one of Whorl's topics, or finds it again.
    ///
    /// # Errors
    /// [`BagError::UnknownPlatform`].
    pub fn add_route(&mut self, route: Route) -> Result<RunTopicHandle, BagError> {
        if let Some(&index) = self.by_route.get(&route) {
            return Ok(RunTopicHandle(index));
        }
        let platforms = &self.manifest.description.platforms;
        let name = route.name(platforms).ok_or(BagError::UnknownPlatform {
            platform: route.platform.map_or(0, |p| p.0),
            count: platforms.len(),
        })?;
        let info = route.topic.info();
        let handle = self.add_topic(
            &name,
            info.message_type.name(),
            &offered_qos_profiles(info.qos),
            expected_rate_hz(route.topic),
        )?;
        self.by_route.insert(route, handle.0);
        Ok(handle)
    }

    /// Records a message of a program that sends it itself (simulation). The topic is added when it first
    /// appears.
    ///
    /// # Errors
    /// As [`BagWriter::write`]; [`BagError::UnknownPlatform`]; [`BagError::Encode`].
    pub fn write_message(
        &mut self,
        route: Route,
        log_time: Timestamp,
        message: &Message,
    ) -> Result<(), BagError> {
        let handle = self.add_route(route)?;
        let mut encoded = std::mem::take(&mut self.encoded);
        let result = message
            .encode_into(&mut encoded)
            .map_err(|source| BagError::Encode { topic: self.name(handle).to_owned(), source })
            .and_then(|()| {
                let origin = message.sequence().map(|sequence| (0, sequence));
                self.write_raw(handle, RawSample { log_time, publish_time: log_time, origin, cdr: &encoded })
            });
        self.encoded = encoded;
        result
    }

    /// Records a message as it came off the wire.
    ///
    /// # Errors
    /// As [`BagWriter::write`].
    pub fn write_raw(&mut self, topic: RunTopicHandle, sample: RawSample<'_>) -> Result<(), BagError> {
        let entry = self.topics.get_mut(topic.0).ok_or(BagError::UnknownTopic { index: topic.0 })?;
        let sequence = sample.origin.map_or(entry.statistics.count(), |(_, sequence)| sequence);
        let result = self.bag.write(
            entry.handle,
            Sample {
                log_time: sample.log_time,
                publish_time: sample.publish_time,
                sequence,
                cdr: sample.cdr,
            },
        );
        if result.is_ok() {
            entry.statistics.observe(sample.log_time, sample.cdr.len());
            if let Some((writer, sequence)) = sample.origin {
                entry.statistics.observe_sequence(writer, sequence);
            }
        }
        self.after(result)
    }

    /// See [`BagWriter::tick`].
    ///
    /// # Errors
    /// As [`BagWriter::tick`].
    pub fn tick(&mut self, now: Timestamp) -> Result<(), BagError> {
        let result = self.bag.tick(now);
        self.after(result)
    }

    /// Bytes in the bag by now.
    #[must_use]
    pub fn bytes_written(&self) -> u64 {
        self.bag.bytes_written()
    }

    /// Messages recorded so far.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.topics.iter().map(|topic| topic.statistics.count()).sum()
    }

    /// Losses so far, all topics together.
    #[must_use]
    pub fn sequence_counts(&self) -> SequenceCounts {
        let counts = self.topics.iter().map(|topic| topic.statistics.sequence_counts());
        counts.fold(SequenceCounts::default(), SequenceCounts::plus)
    }

    /// Why the recording stopped, if it did.
    #[must_use]
    pub fn stopped_by(&self) -> Option<&str> {
        self.stopped_by.as_deref()
    }

    /// Closes bag, manifest and summary. After an error that stopped the recording the manifest says so.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn finish(mut self, stop_utc: Timestamp) -> Result<Manifest, BagError> {
        self.manifest.stop_utc = Some(stop_utc);
        let Self { path, bag, mut manifest, topics, mut stopped_by, .. } = self;
        let closing = match bag.finish_with_size() {
            (Ok(metadata), bytes) => {
                manifest.bag_bytes = bytes;
                let time = |ns: u64| Timestamp(i64::try_from(ns).unwrap_or(i64::MAX));
                manifest.bounds =
                    (metadata.message_count > 0).then(|| (time(metadata.start_ns), time(metadata.end_ns)));
                Ok(())
            }
            (Err(error), bytes) => {
                manifest.bag_bytes = bytes;
                stopped_by.get_or_insert_with(|| error.to_string());
                Err(error)
            }
        };
        manifest.state = stopped_by.map_or(RunState::Complete, RunState::Stopped);
        manifest.topics = topics.iter().map(|t| t.statistics.summary(&t.name, &t.type_name)).collect();
        manifest.write(&path)?;
        update_summary(&path, &manifest_summary(&manifest))?;
        closing.map(|()| manifest)
    }

    fn name(&self, topic: RunTopicHandle) -> &str {
        self.topics.get(topic.0).map_or("", |topic| &topic.name)
    }

    /// Notes in the manifest, while there is room, why the recording stopped.
    fn after(&mut self, result: Result<(), BagError>) -> Result<(), BagError> {
        if let Err(error) = &result
            && self.bag.stopped()
            && self.stopped_by.is_none()
        {
            self.stopped_by = Some(error.to_string());
            self.manifest.state = RunState::Stopped(error.to_string());
            self.manifest.topics =
                self.topics.iter().map(|t| t.statistics.summary(&t.name, &t.type_name)).collect();
            let _ = self.manifest.write(&self.path);
        }
        result
    }
}

/// Whether a path only goes down.
fn is_plain(path: &Path) -> bool {
    path.components().all(|part| matches!(part, std::path::Component::Normal(_)))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Letters, digits, `-`, `_` and `.`; everything else becomes `_`.
fn file_name_of(experiment: &str) -> String {
    let name: String = experiment
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' })
        .collect();
    if name.is_empty() { "run".into() } else { name }
}

/// Creates an empty directory for a run, named after its start and its experiment, that nobody else has: for
/// [`RunWriter::create_in`] and what else belongs to the run.
///
/// # Errors
/// [`BagError::Io`].
pub fn new_run_directory(parent: &Path, experiment: &str, start_utc: Timestamp) -> Result<PathBuf, BagError> {
    std::fs::create_dir_all(parent).map_err(|e| BagError::io("cannot create", parent, e))?;
    let stem = format!("{}_{}", utc(start_utc).replace(':', "-"), file_name_of(experiment));
    create_numbered(parent, &stem)
}

fn create_numbered(parent: &Path, stem: &str) -> Result<PathBuf, BagError> {
    let mut path = parent.join(stem);
    for number in 2.. {
        match std::fs::create_dir(&path) {
            Ok(()) => break,
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                path = parent.join(format!("{stem}_{number}"));
            }
            Err(e) => return Err(BagError::io("cannot create", &path, e)),
        }
    }
    Ok(path)
}
