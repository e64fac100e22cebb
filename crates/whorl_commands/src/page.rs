//! Pages of commands: where they go, and that one which took minutes to find is not lost where it cannot go there.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use whorl_files::NewFile;
use whorl_objects::is_remote;

/// A page that is being written; it is there once it is finished.
pub struct NewPage {
    file: NewFile,
    /// Where it will be.
    pub path: PathBuf,
    /// Why it is not beside its run, if so.
    pub moved: Option<String>,
}

impl NewPage {
    /// At `html`, else where [`page_of`] says, and where nothing can be written there, in the folder `here`.
    ///
    /// # Errors
    /// When no file can be written.
    pub fn create(run: &Path, name: &str, html: Option<&Path>, here: &Path) -> anyhow::Result<Self> {
        let path = html.map_or_else(|| page_of(run, name), Path::to_owned);
        match NewFile::create(&path) {
            Ok(file) => Ok(Self { file, path, moved: None }),
            Err(error) => {
                let failed = || format!("cannot write {}; --html takes another place", path.display());
                let here = path
                    .file_name()
                    .map(|name| here.join(name))
                    .filter(|here| html.is_none() && *here != path);
                let Some(here) = here else { return Err(error).with_context(failed) };
                let file = NewFile::create(&here).with_context(failed)?;
                Ok(Self {
                    file,
                    path: here,
                    moved: Some(format!("cannot write {}: {error}", path.display())),
                })
            }
        }
    }

    /// Fills it, and links the pages that stand beside it; where it is.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn finish(mut self, html: &str) -> anyhow::Result<PathBuf> {
        let written = self.file.write_all(html.as_bytes()).and_then(|()| self.file.finish());
        written.with_context(|| format!("cannot write {}", self.path.display()))?;
        link_pages_beside(&self.path)?;
        Ok(self.path)
    }
}

/// Where the page of a command goes by itself: into a run's directory, where it takes the place of an earlier one; beside a file,
/// named by it (`swing.compare.html` of `swing.csv`), with a number where there is one already. For runs in object storage: here.
#[must_use]
pub fn page_of(run: &Path, name: &str) -> PathBuf {
    if is_remote(run) {
        return PathBuf::from(name);
    }
    if run.is_dir() {
        return run.join(name);
    }
    let file = run.file_name().unwrap_or_default().to_string_lossy();
    let stem =
        [".csv.gz", ".csv", ".mcap"].iter().find_map(|ending| file.strip_suffix(ending)).unwrap_or(&file);
    let page = name.strip_suffix(".html").unwrap_or(name);
    let first = run.with_file_name(format!("{stem}.{name}"));
    let others = (2..u32::MAX).map(|number| run.with_file_name(format!("{stem}.{page}_{number}.html")));
    std::iter::once(first.clone()).chain(others).find(|path| !path.exists()).unwrap_or(first)
}

/// Links the pages of a run that stand beside this one.
///
/// # Errors
/// When one cannot be written.
pub fn link_pages_beside(page: &Path) -> anyhow::Result<()> {
    let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    whorl_report::link_pages(page).with_context(|| format!("cannot link the pages in {}", folder.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_that_cannot_stand_beside_its_run_stands_here() {
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path().join("here");
        std::fs::create_dir(&here).unwrap();
        // A file is no folder in which anything could be written, whoever asks.
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let run = file.join("run.csv");
        let page = NewPage::create(&run, "compare.html", None, &here).unwrap();
        assert_eq!(page.path, here.join("run.compare.html"));
        let moved = page.moved.clone().unwrap();
        assert!(moved.contains("run.compare.html") && moved.starts_with("cannot write"), "{moved}");
        assert_eq!(page.finish("<p>found</p>").unwrap(), here.join("run.compare.html"));
        assert_eq!(std::fs::read_to_string(here.join("run.compare.html")).unwrap(), "<p>found</p>");
        // A place that was asked for is that place or none.
        let asked = file.join("page.html");
        let refused = NewPage::create(&run, "compare.html", Some(&asked), &here).err().unwrap();
        assert!(format!("{refused:#}").contains("--html takes another place"), "{refused:#}");
        let beside = NewPage::create(&here, "compare.html", None, folder.path()).unwrap();
        assert_eq!((beside.path.clone(), &beside.moved), (here.join("compare.html"), &None));
    }
}
