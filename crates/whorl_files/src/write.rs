//! Writing: never through a link, never half.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::fs::OFlags;

/// Names that are tried for the unfinished file, where somebody has taken some.
const TRIED: usize = 1000;

/// A file that takes its place, and that of what stands there, when it is finished. Dropped before, it leaves no trace.
#[derive(Debug)]
pub struct NewFile {
    file: File,
    path: PathBuf,
    /// Where it is until then; `None` for a stream of the operating system, such as `/dev/stdout`.
    beside: Option<PathBuf>,
}

/// Writes a file whole or not at all, in place of what was there.
///
/// # Errors
/// As [`NewFile::create`] and [`NewFile::finish`].
pub fn write_file(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    let mut file = NewFile::create(path)?;
    file.write_all(content.as_ref())?;
    file.finish()
}

/// Adds a line to a file, which is made if there is none.
///
/// # Errors
/// Those of the operating system; a link, which is not followed; a folder, a pipe or a device, except as for [`NewFile::create`].
pub fn append_line(path: &Path, line: &str) -> io::Result<()> {
    if !is_stream(path) {
        refuse_other(path)?;
    }
    // Between the look and the opening somebody may have put a link there, or a pipe that would be waited for.
    let flags = if is_stream(path) { OFlags::empty() } else { OFlags::NOFOLLOW | OFlags::NONBLOCK };
    let mut options = OpenOptions::new();
    options.create(true).append(true).custom_flags(flags.bits().cast_signed());
    options.open(path)?.write_all(format!("{line}\n").as_bytes())
}

/// What stands at `path`, unless it is a folder, a pipe or a device.
fn refuse_other(path: &Path) -> io::Result<Option<fs::Metadata>> {
    let refused = |what: &str| {
        Err(io::Error::new(ErrorKind::InvalidInput, format!("there is {what}; allowed: a file")))
    };
    match fs::symlink_metadata(path) {
        Ok(old) if old.is_dir() => refused("a folder"),
        Ok(old) if !old.is_file() && !old.is_symlink() => refused("a pipe or a device"),
        Ok(old) => Ok(Some(old)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

impl NewFile {
    /// Begins a file. It keeps the permissions of the file whose place it takes.
    ///
    /// # Errors
    /// Those of the operating system; a folder, a pipe or a device at `path`, apart from those of `/dev` itself, `/dev/fd` and
    /// `/proc`, which a user names to have a stream.
    pub fn create(path: &Path) -> io::Result<Self> {
        if is_stream(path) {
            let file = OpenOptions::new().append(true).open(path)?;
            return Ok(Self { file, path: path.to_owned(), beside: None });
        }
        let old = refuse_other(path)?;
        let (file, beside) = create_beside(path)?;
        let new = Self { file, path: path.to_owned(), beside: Some(beside) };
        if let Some(old) = old.filter(fs::Metadata::is_file) {
            new.file.set_permissions(old.permissions())?;
        }
        Ok(new)
    }

    /// Puts it in its place.
    ///
    /// # Errors
    /// Those of the operating system; what stood there is as it was.
    pub fn finish(mut self) -> io::Result<()> {
        self.file.flush()?;
        match &self.beside {
            Some(beside) => {
                fs::rename(beside, &self.path)?;
                self.beside = None;
                Ok(())
            }
            None => Ok(()),
        }
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for NewFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if let Some(beside) = &self.beside {
            let _ = fs::remove_file(beside);
        }
    }
}

fn is_stream(path: &Path) -> bool {
    path.starts_with("/proc")
        || path.parent().is_some_and(|folder| ["/dev", "/dev/fd"].map(Path::new).contains(&folder))
}

/// Creates a file of its own in the folder of `path`: one that is there, a link too, is left alone.
fn create_beside(path: &Path) -> io::Result<(File, PathBuf)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let mut taken = None;
    for _ in 0..TRIED {
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        // Short, whatever the name of the file is, and hidden from those who list the folder.
        let beside = path.with_file_name(format!(".whorl-{}-{number}.new", std::process::id()));
        match OpenOptions::new().write(true).create_new(true).open(&beside) {
            Ok(file) => return Ok((file, beside)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => taken = Some(error),
            Err(error) => return Err(error),
        }
    }
    Err(taken.unwrap_or_else(|| io::Error::other("no name is free")))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn links_are_replaced_and_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("victim"), "precious").unwrap();
        symlink(at("victim"), at("report.html")).unwrap();
        // A link that leads nowhere would be followed to make its target.
        symlink(at("nowhere"), at("summary.json")).unwrap();
        for name in ["report.html", "summary.json", "new"] {
            write_file(&at(name), name).unwrap();
            assert_eq!(fs::read_to_string(at(name)).unwrap(), name);
            assert!(fs::symlink_metadata(at(name)).unwrap().is_file(), "{name} is still a link");
        }
        assert_eq!(fs::read_to_string(at("victim")).unwrap(), "precious");
        assert_eq!(names(folder.path()), ["new", "report.html", "summary.json", "victim"]);
    }

    #[test]
    fn lines_are_added_to_files_alone() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        ["one", "two"].iter().for_each(|line| append_line(&at("lines"), line).unwrap());
        assert_eq!(fs::read_to_string(at("lines")).unwrap(), "one\ntwo\n");
        symlink(at("lines"), at("link")).unwrap();
        symlink(at("nowhere"), at("loose")).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        for name in ["link", "loose", "pipe", "."] {
            assert!(append_line(&at(name), "three").is_err(), "{name} is written to");
        }
        assert_eq!(fs::read_to_string(at("lines")).unwrap(), "one\ntwo\n");
        assert!(!at("nowhere").exists());
    }

    #[test]
    fn names_that_somebody_has_prepared_are_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let victim = folder.path().join("victim");
        fs::write(&victim, "precious").unwrap();
        let own = |number: u32| folder.path().join(format!(".whorl-{}-{number}.new", std::process::id()));
        (0..64).for_each(|number| symlink(&victim, own(number)).unwrap());
        write_file(&folder.path().join("report.html"), "page").unwrap();
        assert_eq!(fs::read_to_string(&victim).unwrap(), "precious");
        assert_eq!(fs::read_to_string(folder.path().join("report.html")).unwrap(), "page");
    }

    #[test]
    fn what_is_not_finished_leaves_the_old_file_and_no_trace() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "old").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"ne").unwrap();
        drop(file);
        assert_eq!((fs::read_to_string(&path).unwrap(), names(folder.path()).len()), ("old".to_owned(), 1));
        write_file(&path, "new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[test]
    fn folders_and_pipes_are_refused_and_streams_are_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let refused = |path: &Path| write_file(path, "x").unwrap_err().to_string();
        assert!(refused(folder.path()).contains("a folder"));
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        assert!(refused(&pipe).contains("a pipe or a device"));
        write_file(Path::new("/dev/null"), "x").unwrap();
        append_line(Path::new("/dev/null"), "x").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
