//! A campaign's folder in object storage: rows and tables are objects, which all workers see, wherever they are.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::TempDir;
use whorl_objects::Place;

use super::{Hold, Store, row_name};

/// The campaign in object storage, and this process's folder for what is on its way there.
#[derive(Debug)]
pub(crate) struct Remote {
    place: Place,
    ending: &'static str,
    own: TempDir,
    /// Tasks that were done when their rows were last listed, and those that this process has done since.
    done: Mutex<BTreeSet<u64>>,
}

impl Remote {
    /// The place of a path, with its rows.
    pub fn open(path: &Path, ending: &'static str) -> io::Result<Self> {
        let own = tempfile::Builder::new().prefix("whorl-campaign-").tempdir()?;
        let remote = Self { place: Place::open(path)?, ending, own, done: Mutex::default() };
        remote.done()?;
        Ok(remote)
    }

    /// Folder of this process; it goes with it.
    pub fn own(&self) -> &Path {
        self.own.path()
    }

    fn decoded(&self, name: &str, bytes: Vec<u8>) -> io::Result<String> {
        let address = self.place.address();
        String::from_utf8(bytes).map_err(|error| io::Error::other(format!("{address}/{name}: {error}")))
    }

    fn known(&self) -> MutexGuard<'_, BTreeSet<u64>> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store for Remote {
    fn text(&self, name: &str) -> io::Result<Option<String>> {
        self.place.get(name)?.map(|bytes| self.decoded(name, bytes)).transpose()
    }

    fn texts(&self, names: &[String]) -> io::Result<Vec<Option<String>>> {
        let found = self.place.get_all(names)?.into_iter().zip(names);
        found.map(|(bytes, name)| bytes.map(|bytes| self.decoded(name, bytes)).transpose()).collect()
    }

    fn store(&self, name: &str, text: &str) -> io::Result<()> {
        Ok(self.place.put(name, text.as_bytes().to_vec())?)
    }

    fn store_once(&self, name: &str, text: &str) -> io::Result<()> {
        self.place.put_new(name, text.as_bytes().to_vec())?;
        Ok(())
    }

    fn has_files_in(&self, name: &str) -> io::Result<bool> {
        Ok(!self.place.below(name).names()?.is_empty())
    }

    fn has(&self, index: u64) -> bool {
        self.known().contains(&index)
    }

    fn store_row(&self, index: u64, row: &str) -> io::Result<()> {
        self.store(&self.row_name(index), row)?;
        self.known().insert(index);
        Ok(())
    }

    fn done(&self) -> io::Result<u64> {
        let rows = self.place.below("rows").names()?;
        let number = |name: &String| name.strip_suffix(self.ending)?.strip_suffix('.')?.parse().ok();
        let there: BTreeSet<u64> = rows.iter().filter_map(number).collect();
        let mut done = self.known();
        *done = there;
        Ok(done.len() as u64)
    }

    fn hold(&self) -> io::Result<Hold> {
        Ok(Hold { _file: None })
    }

    fn row_name(&self, index: u64) -> String {
        row_name(index, self.ending)
    }

    fn address(&self, name: &Path) -> PathBuf {
        Path::new(self.place.address()).join(name)
    }

    fn publish(&self, folder: &Path) -> io::Result<()> {
        self.place.publish(folder)?;
        Ok(())
    }

    fn room_for_a_task(&self) -> io::Result<Option<TempDir>> {
        tempfile::tempdir_in(self.own()).map(Some)
    }
}
