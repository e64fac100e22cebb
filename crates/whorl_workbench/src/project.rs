//! The folder that is open: which of its files are recordings, models and maps.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash as _, Hasher as _};
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context as _, bail};
use whorl_commands::runs::{RunSources, is_csv};

use crate::api::{Choice, FileKind, FileRow};

/// Folders below the opened one that are looked into.
const DEPTH: usize = 3;
/// Entries that are looked at, and files that are listed.
const ENTRIES: usize = 5_000;
const LISTED: usize = 400;
/// Parameter files are smaller.
const LARGEST_YAML: u64 = 1 << 20;
/// What was chosen, for the next time; a file of its own, so that models stay what they are.
const REMEMBERED: &str = ".whorl_open.json";
/// Folders with texts of models before each step, with effects, and those of programs.
const NOT_FOR_US: [&str; 4] = ["history", "effects", "target", "node_modules"];

/// The folder as it was looked at.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Seen {
    /// Its files, by path.
    pub files: Vec<FileRow>,
    /// Changes with any of them.
    pub print: u64,
}

/// Looks at the folder.
pub fn look(folder: &Path) -> Seen {
    let mut found = Found { files: Vec::new(), print: DefaultHasher::new(), left: ENTRIES };
    found.folder(folder, "", 0);
    found.files.sort_by(|a, b| a.path.cmp(&b.path));
    Seen { files: found.files, print: found.print.finish() }
}

struct Found {
    files: Vec<FileRow>,
    print: DefaultHasher,
    left: usize,
}

impl Found {
    fn folder(&mut self, folder: &Path, below: &str, depth: usize) {
        let Ok(entries) = std::fs::read_dir(folder) else { return };
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok()).take(self.left).collect();
        names.sort();
        for name in names {
            if self.left == 0 || self.files.len() >= LISTED || name.starts_with('.') {
                continue;
            }
            self.left -= 1;
            let (path, shown) = (folder.join(&name), format!("{below}{name}"));
            let Ok(about) = std::fs::metadata(&path) else { continue };
            if about.is_dir() {
                if is_run(&path) {
                    let bytes = size_of_run(&path, &mut self.print);
                    self.add(shown, FileKind::Recording, bytes);
                } else if depth < DEPTH && !NOT_FOR_US.contains(&name.as_str()) {
                    self.folder(&path, &format!("{shown}/"), depth + 1);
                }
                continue;
            }
            let Some(kind) = kind_of(&path, about.len()) else { continue };
            (about.len(), about.modified().ok().and_then(|t| t.duration_since(SystemTime::UNIX_EPOCH).ok()))
                .hash(&mut self.print);
            self.add(shown, kind, about.len());
        }
    }

    fn add(&mut self, path: String, kind: FileKind, bytes: u64) {
        path.hash(&mut self.print);
        self.files.push(FileRow { path, kind, bytes });
    }
}

/// A run directory, or a folder with a bag.
fn is_run(folder: &Path) -> bool {
    ["manifest.yaml", "metadata.yaml", "bag/metadata.yaml"].iter().any(|file| folder.join(file).is_file())
}

fn size_of_run(folder: &Path, print: &mut DefaultHasher) -> u64 {
    let bag = folder.join("bag");
    let entries = std::fs::read_dir(if bag.is_dir() { &bag } else { folder });
    let files = entries.into_iter().flatten().take(ENTRIES).filter_map(|entry| entry.ok()?.metadata().ok());
    let bytes = files.filter(std::fs::Metadata::is_file).map(|about| about.len()).sum();
    u64::hash(&bytes, print);
    bytes
}

fn kind_of(path: &Path, bytes: u64) -> Option<FileKind> {
    if is_csv(path) || whorl_bag::is_bag(path) {
        return Some(FileKind::Recording);
    }
    let is_yaml = path.extension().is_some_and(|end| end == "yaml" || end == "yml");
    if !is_yaml || bytes > LARGEST_YAML {
        return None;
    }
    let text = whorl_files::read_text(path).ok()?;
    let begins = |words: &[&str]| {
        let mut lines = text.lines().map(str::trim_end);
        lines.any(|line| words.iter().any(|word| line.starts_with(word)))
    };
    if begins(&["csv:", "bag:", "/csv:", "/bag:"]) {
        return Some(FileKind::Map);
    }
    let has_model = text.lines().any(|line| line.trim_start().starts_with("model:"));
    (has_model && text.contains("ros__parameters")).then_some(FileKind::Model)
}

/// A path of the folder that was named by a page: as it is listed, or as it would be.
///
/// # Errors
/// What leads out of the folder, is hidden, or is too deep.
pub fn inside(folder: &Path, named: &str) -> anyhow::Result<PathBuf> {
    let path = Path::new(named);
    let parts: Vec<Component<'_>> = path.components().collect();
    let is_plain = |part: &Component<'_>| matches!(part, Component::Normal(name) if !name.to_string_lossy().starts_with('.'));
    if parts.is_empty() || parts.len() > DEPTH + 1 || !parts.iter().all(is_plain) || named.contains('\0') {
        bail!(
            "{named:?} is no file of this folder: names below it are allowed, none that begin with a point"
        );
    }
    Ok(folder.join(path))
}

/// The files of a choice, as a command has them that is called in the folder.
pub fn sources(choice: &Choice) -> RunSources {
    RunSources {
        runs: choice.runs.iter().map(PathBuf::from).collect(),
        held_out: choice.held_out.iter().map(PathBuf::from).collect(),
        model: choice.model.as_ref().map(PathBuf::from),
        platform: choice.platform.clone(),
        channels: choice.channels.as_ref().map(PathBuf::from),
    }
}

/// The same from anywhere.
pub fn sources_in(folder: &Path, choice: &Choice) -> RunSources {
    let here = sources(choice);
    let at = |path: PathBuf| folder.join(path);
    RunSources {
        runs: here.runs.into_iter().map(at).collect(),
        held_out: here.held_out.into_iter().map(at).collect(),
        model: here.model.map(at),
        channels: here.channels.map(at),
        platform: here.platform,
    }
}

/// What of a choice there is no longer goes; where nothing was chosen, what leaves no doubt is. A model or a map stays
/// while its file is there, whatever the file says now: who writes it may not be done.
pub fn completed(mut choice: Choice, folder: &Path, files: &[FileRow]) -> Choice {
    let of =
        |kind: FileKind| files.iter().filter(move |file| file.kind == kind).map(|file| file.path.as_str());
    let is = |kind: FileKind, path: &String| of(kind).any(|there| there == path);
    let is_there = |path: &String| {
        !files.iter().any(|file| file.path == *path) && inside(folder, path).is_ok_and(|path| path.is_file())
    };
    choice.runs.retain(|path| is(FileKind::Recording, path));
    choice.held_out.retain(|path| is(FileKind::Recording, path));
    choice.model = choice.model.filter(|path| is(FileKind::Model, path) || is_there(path));
    choice.channels = choice.channels.filter(|path| is(FileKind::Map, path) || is_there(path));
    if choice.runs.is_empty() && choice.held_out.is_empty() {
        choice.runs.extend(of(FileKind::Recording).next().map(str::to_owned));
    }
    let own = choice.runs.first().and_then(|run| run.split('.').next()).unwrap_or_default().to_owned();
    let only = |kind: FileKind, of_run: &[String]| {
        let named = of(kind).find(|path| of_run.iter().any(|name| name == path));
        let mut all = of(kind);
        let single = all.next().filter(|_| all.next().is_none());
        named.or(single).map(str::to_owned)
    };
    let has_own_model = choice.runs.first().is_some_and(|run| !run.contains('.'));
    if choice.model.is_none() && !has_own_model {
        choice.model = only(FileKind::Model, &[format!("{own}.yaml")]);
    }
    if choice.channels.is_none() && !has_own_model {
        choice.channels = only(FileKind::Map, &[format!("{own}.channels.yaml")]);
    }
    choice
}

/// What was chosen the last time.
pub fn remembered(folder: &Path) -> Choice {
    let text = whorl_files::read_text(&folder.join(REMEMBERED)).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

/// For the next time.
///
/// # Errors
/// When it cannot be written.
pub fn remember(folder: &Path, choice: &Choice) -> anyhow::Result<()> {
    let path = folder.join(REMEMBERED);
    whorl_files::write_file(&path, serde_json::to_string_pretty(choice)?)
        .with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: &str = "/rig/**:\n  ros__parameters:\n    model:\n      mass_kg: 1.0\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }

    #[test]
    fn files_are_told_by_what_is_in_them() {
        let folder = folder(&[
            ("rig.yaml", MODEL),
            ("rig.channels.yaml", "# map\ncsv:\n  ros__parameters: {}\n"),
            ("swing.csv", "t,gx\n0,1\n"),
            ("runs/one/metadata.yaml", ""),
            ("runs/one/one.mcap", "1234"),
            ("notes.txt", "model:"),
            ("history/rig_before_step_1.yaml", MODEL),
            (".hidden.csv", ""),
            ("a/b/c/d/deep.csv", ""),
        ]);
        let seen = look(folder.path());
        let of: Vec<(&str, FileKind)> =
            seen.files.iter().map(|file| (file.path.as_str(), file.kind)).collect();
        assert_eq!(
            of,
            [
                ("rig.channels.yaml", FileKind::Map),
                ("rig.yaml", FileKind::Model),
                ("runs/one", FileKind::Recording),
                ("swing.csv", FileKind::Recording)
            ]
        );
        assert_eq!(look(folder.path()), seen);
        std::fs::write(folder.path().join("swing.csv"), "t,gx\n0,1\n1,2\n").unwrap();
        assert_ne!(look(folder.path()).print, seen.print, "it has changed");
    }

    #[test]
    fn no_name_leads_out_of_the_folder() {
        let folder = Path::new("/data");
        assert_eq!(inside(folder, "runs/a.csv").unwrap(), Path::new("/data/runs/a.csv"));
        for name in
            ["", "..", "../a.csv", "/etc/passwd", "a/../../b", ".ssh/id", "a/.b", "a/b/c/d/e.csv", "a\0"]
        {
            assert!(inside(folder, name).is_err(), "{name}");
        }
    }

    #[test]
    fn what_leaves_no_doubt_is_chosen() {
        let folder = folder(&[
            ("rig.yaml", MODEL),
            ("swing.yaml", MODEL),
            ("map.yaml", "csv:\n"),
            ("swing.csv", ""),
            ("other.csv", ""),
        ]);
        let files = look(folder.path()).files;
        let wanted =
            Choice { runs: vec!["swing.csv".to_owned(), "gone.csv".to_owned()], ..Choice::default() };
        let choice = completed(wanted, folder.path(), &files);
        assert_eq!(choice.runs, ["swing.csv"]);
        assert_eq!(choice.model.as_deref(), Some("swing.yaml"), "that of its name");
        assert_eq!(choice.channels.as_deref(), Some("map.yaml"), "the only one");
        let other = completed(Choice::default(), folder.path(), &files);
        assert_eq!(
            (other.runs, other.model),
            (vec!["other.csv".to_owned()], None),
            "two models: a person chooses"
        );
        std::fs::write(folder.path().join("swing.yaml"), "").unwrap();
        let written = completed(choice.clone(), folder.path(), &look(folder.path()).files);
        assert_eq!(written, choice, "somebody is writing to its file");
        std::fs::remove_file(folder.path().join("swing.yaml")).unwrap();
        let gone = completed(choice.clone(), folder.path(), &look(folder.path()).files);
        assert_eq!(gone.model.as_deref(), Some("rig.yaml"));
        remember(folder.path(), &choice).unwrap();
        assert_eq!(remembered(folder.path()), choice);
        std::fs::write(folder.path().join(REMEMBERED), "{").unwrap();
        assert_eq!(remembered(folder.path()), Choice::default());
    }
}
