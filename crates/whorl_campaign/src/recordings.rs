//! Campaigns over recordings: which recordings, and what is asked of each.
//!
//! The list of recordings is kept in the campaign's folder, so that all who work on it mean the same by a number. Recordings
//! that match later are appended; none is ever taken out.

use std::io;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};
use tempfile::TempDir;
use whorl_bag::{MANIFEST_FILE, RunDirectory};
use whorl_objects::{Place, is_remote};
use whorl_params::Reader;

use crate::work::Folder;

/// Name of the list in the campaign's folder.
const LIST: &str = "recordings.json";

/// What is asked of each recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// How far off the model is, as `whorl compare`.
    Compare,
    /// Which effect the model lacks, as `whorl diagnose`.
    Diagnose,
    /// Its attitudes, as `whorl estimate`.
    Estimate,
}

impl Question {
    /// All, by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("compare", Self::Compare), ("diagnose", Self::Diagnose), ("estimate", Self::Estimate)];

    /// Its name in campaign files.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, one)| *one == self).map_or("", |(name, _)| name)
    }
}

/// What a campaign over recordings asks. Paths are relative to the campaign's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordingsDefinition {
    /// Its name.
    pub name: String,
    /// Patterns of paths: run directories, bags, CSV files.
    pub recordings: Vec<String>,
    /// What is asked of each.
    pub question: Question,
    /// Platforms; empty: all of each recording.
    pub platforms: Vec<String>,
    /// The platform's parameter file; `None`: the parameters saved in each recording.
    pub model: Option<String>,
    /// Map of topics or columns.
    pub channels: Option<String>,
    /// Files of effects that are added to the catalogue.
    pub effects: Vec<String>,
    /// Compare: whether the platform's own parameters are refitted first.
    pub refit: bool,
    /// Diagnose: effects that are not considered.
    pub exclude: Vec<String>,
    /// Estimate: name of the filter.
    pub filter: Option<String>,
    /// Estimate: from the whole recording.
    pub smooth: bool,
}

/// Reads a campaign over recordings. Errors stay in the reader.
pub fn read(r: &mut Reader<'_>) -> RecordingsDefinition {
    for key in ["experiments", "sweep", "seeds"] {
        if r.has(key) {
            r.reject(
                key,
                "it does not go with `recordings`; a campaign is over experiments or over recordings",
            );
        }
    }
    let name = r.string_or("name", "campaign", "name of the campaign");
    let recordings = r.string_array(
        "recordings",
        "in place of experiments: patterns of run directories, rosbag2 directories, .mcap and CSV files; * and ? within a name, ** for \
         folders; relative to the campaign's file, or s3://BUCKET/PREFIX in object storage",
    );
    if recordings.is_empty() && r.has("recordings") {
        r.reject("recordings", "the list is empty; allowed: at least one pattern");
    }
    let names = Question::ALL.map(|(name, _)| name);
    let asked = r.choice(
        "task",
        &names,
        "what is asked of each recording: as `whorl compare`, `diagnose` or `estimate`",
    );
    let question =
        Question::ALL.into_iter().find(|(name, _)| *name == asked).map_or(Question::Compare, |(_, q)| q);
    let definition = RecordingsDefinition {
        name,
        recordings,
        question,
        platforms: r.string_array_or(
            "platforms",
            &[],
            "names of the platforms; none: every platform of each recording",
        ),
        model: r.optional_string(
            "model_file",
            "the platform's parameter file [default: the parameters saved in each recording]",
        ),
        channels: r
            .optional_string("channels", "map of topics or columns, for recordings that Whorl did not make"),
        effects: r.string_array_or("effects", &[], "files of effects that are added to the catalogue"),
        refit: r.bool_or("refit", false, "task compare: refits the platform's own parameters first"),
        exclude: r.string_array_or("exclude", &[], "task diagnose: ids of effects that are not considered"),
        filter: r
            .optional_string("filter", "task estimate: name of the filter, as of `whorl estimate --filter`"),
        smooth: r.bool_or("smooth", false, "task estimate: each attitude from the whole recording"),
    };
    let elsewhere = |wanted: Question| definition.question != wanted;
    for (key, wanted, given) in [
        ("refit", Question::Compare, definition.refit),
        ("exclude", Question::Diagnose, !definition.exclude.is_empty()),
        ("filter", Question::Estimate, definition.filter.is_some()),
        ("smooth", Question::Estimate, definition.smooth),
    ] {
        if given && elsewhere(wanted) {
            r.reject(
                key,
                format!("it is for `task: {}`, not for {}", wanted.name(), definition.question.name()),
            );
        }
    }
    definition
}

/// One task: a platform in a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Item {
    /// Path of the recording, as the pattern gave it: relative to the campaign's file, or absolute.
    pub recording: String,
    /// The platform; `None`: the only one.
    pub platform: Option<String>,
    /// Whether effects of its own are saved with it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub has_effects: bool,
}

impl RecordingsDefinition {
    /// The recordings that match now, in the order of the patterns, each of its platforms once. `base` is the folder of the
    /// campaign's file.
    ///
    /// # Errors
    /// A pattern that is none, a folder that cannot be read, or nothing that matches.
    pub fn found(&self, base: &Path) -> io::Result<Vec<Item>> {
        let mut items: Vec<Item> = Vec::new();
        let mut seen = std::collections::BTreeSet::new();
        for pattern in &self.recordings {
            let none = |error| io::Error::other(format!("recordings: `{pattern}` is no pattern: {error}"));
            if is_remote(Path::new(pattern)) {
                for address in stored(pattern, none)? {
                    if seen.insert(address.clone()) {
                        let manifest = manifest_of(&address)?;
                        items.extend(self.items_of(manifest.as_ref().map(TempDir::path), address));
                    }
                }
                continue;
            }
            let whole = base.join(pattern);
            let whole = whole.to_string_lossy();
            for path in glob::glob(&whole).map_err(none)? {
                let path = path.map_err(io::Error::other)?;
                let named = relative(&path, base);
                if seen.insert(named.clone()) {
                    items.extend(self.items_of(Some(&path), named));
                }
            }
        }
        if items.is_empty() {
            return Err(io::Error::other(format!(
                "no recording matches {} in {}{}",
                self.recordings.join(", "),
                if base.as_os_str().is_empty() { ".".to_owned() } else { base.display().to_string() },
                if self.platforms.is_empty() {
                    String::new()
                } else {
                    format!(", or none has {}", self.platforms.join(", "))
                },
            )));
        }
        Ok(items)
    }

    /// `path` is where its manifest is read.
    fn items_of(&self, path: Option<&Path>, recording: String) -> Vec<Item> {
        let run = path.and_then(|path| RunDirectory::open(path).ok());
        let manifest = run.as_ref().and_then(RunDirectory::manifest);
        let held = manifest.map(|manifest| manifest.description.platforms.clone()).unwrap_or_default();
        let has_effects = manifest.is_some_and(|manifest| {
            let folder = |file: &String| Path::new(file).parent().is_some_and(|p| p.ends_with("effects"));
            manifest.parameters.iter().any(|file| folder(&file.file))
        });
        let platforms: Vec<Option<String>> = match (held.is_empty(), self.platforms.is_empty()) {
            // A bag or a table does not say whose it is.
            (true, true) => vec![None],
            (true, false) => self.platforms.iter().cloned().map(Some).collect(),
            (false, true) => held.into_iter().map(Some).collect(),
            (false, false) => {
                held.into_iter().filter(|name| self.platforms.contains(name)).map(Some).collect()
            }
        };
        platforms
            .into_iter()
            .map(|platform| Item { recording: recording.clone(), platform, has_effects })
            .collect()
    }

    /// The list in the folder; made of what matches now where there is none.
    ///
    /// # Errors
    /// As [`Self::found`]; a list that cannot be read or written.
    pub fn listed(&self, base: &Path, folder: &Folder) -> io::Result<Vec<Item>> {
        if folder.text(LIST)?.is_none() {
            folder.store_text_once(LIST, &text(&self.found(base)?)?)?;
        }
        let list = folder.text(LIST)?.unwrap_or_default();
        let path = folder.told(&folder.path().join(LIST));
        serde_json::from_str(&list).map_err(|error| io::Error::other(format!("{}: {error}", path.display())))
    }

    /// The list with what matches now and was not in it, at its end. For who holds the folder.
    ///
    /// # Errors
    /// As [`Self::listed`].
    pub fn extended(&self, base: &Path, folder: &Folder) -> io::Result<Vec<Item>> {
        let mut items = self.listed(base, folder)?;
        let before = items.len();
        for item in self.found(base)? {
            let known = |other: &Item| other.recording == item.recording && other.platform == item.platform;
            if !items.iter().take(before).any(known) {
                items.push(item);
            }
        }
        if items.len() > before {
            folder.store_text(LIST, &text(&items)?)?;
        }
        Ok(items)
    }
}

fn text(items: &[Item]) -> io::Result<String> {
    let lines: Vec<String> =
        items.iter().map(serde_json::to_string).collect::<Result<_, _>>().map_err(io::Error::other)?;
    Ok(format!("[\n{}\n]\n", lines.join(",\n")))
}

/// Addresses of what matches a pattern in object storage: objects, and what stands before a slash in their names.
fn stored(pattern: &str, none: impl Fn(glob::PatternError) -> io::Error) -> io::Result<Vec<String>> {
    let wanted = glob::Pattern::new(pattern).map_err(&none)?;
    let options = glob::MatchOptions { require_literal_separator: true, ..glob::MatchOptions::default() };
    // Only what is below the last folder that has no wildcard is listed.
    let fixed = pattern.find(['*', '?', '[']).map_or(pattern, |first| &pattern[..first]);
    let above = fixed.rfind('/').map_or("", |last| &fixed[..last]);
    let place = Place::open(Path::new(above))?;
    let mut found = std::collections::BTreeSet::new();
    for name in place.names()? {
        let address = format!("{}/{name}", place.address());
        let ends = address.match_indices('/').map(|(at, _)| at).chain([address.len()]);
        for end in ends.filter(|end| *end > above.len()) {
            if wanted.matches_with(&address[..end], options) {
                found.insert(address[..end].to_owned());
            }
        }
    }
    Ok(found.into_iter().collect())
}

/// A folder with the manifest of a run in object storage, and nothing else of it; `None` where it has none.
fn manifest_of(address: &str) -> io::Result<Option<TempDir>> {
    let Some(manifest) = Place::open(Path::new(address))?.get(MANIFEST_FILE)? else { return Ok(None) };
    let folder = tempfile::tempdir()?;
    whorl_files::write_file(&folder.path().join(MANIFEST_FILE), manifest)?;
    Ok(Some(folder))
}

/// As a pattern that is relative to `base` says it.
fn relative(path: &Path, base: &Path) -> String {
    let path = path.strip_prefix(base).unwrap_or(path);
    let plain: PathBuf = path.components().filter(|part| !matches!(part, Component::CurDir)).collect();
    plain.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use whorl_params::{ParameterTree, try_read};

    use super::*;

    fn definition(text: &str) -> Result<RecordingsDefinition, String> {
        let text = format!("/campaign:\n  ros__parameters:\n    {}\n", text.replace("; ", "\n    "));
        let tree = ParameterTree::from_texts(&[("test.yaml", &text)], &[]).map_err(|e| e.to_string())?;
        try_read(&tree.for_node("/campaign"), |r| Some(read(r))).map(|(d, _)| d).map_err(|e| e.to_string())
    }

    fn names(items: &[Item]) -> Vec<&str> {
        items.iter().map(|item| item.recording.as_str()).collect()
    }

    #[test]
    fn patterns_give_each_recording_once_and_the_list_only_grows() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.csv", "a.csv", "deep/er/c.csv", "a.txt"] {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let of = definition("recordings: ['./*.csv', 'a.*', '**/c.csv']; task: compare").unwrap();
        let folder = Folder::open(&dir.path().join("out"), "x", "json").unwrap();
        let first = of.listed(dir.path(), &folder).unwrap();
        assert_eq!(names(&first), ["a.csv", "b.csv", "a.txt", "deep/er/c.csv"]);

        // Numbers stay: what is new comes last, though its name is the first; what is gone stays.
        fs::write(dir.path().join("0.csv"), "").unwrap();
        fs::remove_file(dir.path().join("b.csv")).unwrap();
        assert_eq!(of.listed(dir.path(), &folder).unwrap(), first);
        let more = of.extended(dir.path(), &folder).unwrap();
        assert_eq!(names(&more), ["a.csv", "b.csv", "a.txt", "deep/er/c.csv", "0.csv"]);
        assert_eq!(of.listed(dir.path(), &folder).unwrap(), more);
    }

    #[test]
    fn each_platform_of_a_run_is_a_task() {
        let dir = tempfile::tempdir().unwrap();
        let described = whorl_bag::RunDescription {
            platforms: ["whorl_1", "whorl_2"].map(str::to_owned).to_vec(),
            ..whorl_bag::RunDescription::default()
        };
        let run = dir.path().join("run");
        let begun = whorl_node::Timestamp(0);
        let mut writer =
            whorl_bag::RunWriter::create_in(&run, described, begun, whorl_bag::BagOptions::default())
                .unwrap();
        writer.tick(begun).unwrap();
        writer.finish(begun).unwrap();
        let platforms = |text: &str| -> Vec<Option<String>> {
            let items = definition(text).unwrap().found(dir.path()).unwrap();
            items.into_iter().map(|item| item.platform).collect()
        };
        let both = platforms("recordings: [run]; task: diagnose");
        assert_eq!(both, [Some("whorl_1".to_owned()), Some("whorl_2".to_owned())]);
        assert_eq!(
            platforms("recordings: [run]; task: diagnose; platforms: [whorl_2]"),
            [Some("whorl_2".to_owned())]
        );
        let none = definition("recordings: [run]; task: diagnose; platforms: [whorl_3]").unwrap();
        let error = none.found(dir.path()).unwrap_err().to_string();
        assert!(error.contains("no recording matches run") && error.contains("none has whorl_3"), "{error}");
    }

    #[test]
    fn what_does_not_go_together_is_refused_in_words() {
        for (text, said) in [
            ("recordings: [a]; task: invent", "compare"),
            ("recordings: []; task: compare", "the list is empty"),
            ("recordings: [a]", "task"),
            ("recordings: [a]; task: compare; smooth: true", "it is for `task: estimate`, not for compare"),
            ("recordings: [a]; task: compare; seeds: 3", "it does not go with `recordings`"),
            ("recordings: [a]; task: compare; platfroms: x", "did you mean"),
        ] {
            let error = definition(text).unwrap_err();
            assert!(error.contains(said), "{text}: {error}");
        }
        let error =
            definition("recordings: ['a/***']; task: compare").unwrap().found(Path::new("")).unwrap_err();
        assert!(error.to_string().contains("`a/***` is no pattern"), "{error}");
    }
}
