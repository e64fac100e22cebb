//! Campaigns as lists of tasks, for engines of Python.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::prelude::*;
use whorl_campaign::work::{Folder, Hold, Tasks, run};
use whorl_commands::campaign::{Campaign as Planned, planned};

use crate::errors::{error, refused};
use crate::watch::watched;

/// A campaign file with its folder.
#[pyclass(frozen, module = "whorl._native")]
pub struct Campaign {
    plan: Arc<Planned>,
    folder: Folder,
}

#[pymethods]
impl Campaign {
    /// `grow`: whether recordings that have been added since are taken in, unless another process works on the folder.
    #[new]
    #[pyo3(signature = (file, out, params=None, seeds=None, grow=true))]
    fn new(
        file: PathBuf,
        out: PathBuf,
        params: Option<PathBuf>,
        seeds: Option<u64>,
        grow: bool,
    ) -> PyResult<Self> {
        let mut plan = planned(&file, params.as_deref(), seeds).map_err(error)?;
        let folder = plan.open(&out).map_err(error)?;
        let held = if grow { folder.hold().ok() } else { None };
        plan.list(&folder, held.is_some()).map_err(error)?;
        Ok(Self { plan: Arc::new(plan), folder })
    }

    fn __len__(&self) -> usize {
        usize::try_from(self.plan.len()).unwrap_or(usize::MAX)
    }

    /// Runs that have no row yet.
    fn missing(&self) -> PyResult<Vec<u64>> {
        // What others have done since is not missing.
        self.folder.done().map_err(error)?;
        Ok((0..self.plan.len()).filter(|index| !self.folder.has(*index)).collect())
    }

    /// Takes charge of the folder, until the object is released or gone.
    fn hold(&self) -> PyResult<Held> {
        Ok(Held(Mutex::new(Some(self.folder.hold().map_err(error)?))))
    }

    /// Computes a task and stores its row, unless it has one.
    fn run(&self, py: Python<'_>, index: u64) -> PyResult<()> {
        if index >= self.plan.len() {
            return Err(refused(format!("run {index}: allowed: 0 to {}", self.plan.len().saturating_sub(1))));
        }
        if self.folder.has(index) {
            return Ok(());
        }
        let (plan, folder) = (Arc::clone(&self.plan), self.folder.clone());
        watched(py, None, move |_| Ok(run(&folder, &*plan, index)?))
    }

    /// What its tasks are called.
    fn noun(&self) -> &'static str {
        self.plan.noun()
    }

    /// Writes the tables of what is done: CSV, folder of Parquet files, further such folders, page; how many rows they have,
    /// and what came of them.
    fn write_tables(&self) -> PyResult<Written> {
        let t = self.plan.write_tables(&self.folder).map_err(error)?;
        // As texts: Python's paths do not keep the two slashes of an address.
        let text = |path: &PathBuf| path.display().to_string();
        let further = t.further.iter().map(text).collect();
        Ok((text(&t.csv), text(&t.parquet), further, t.page.as_ref().map(text), t.rows, t.said))
    }
}

/// CSV, folder of Parquet files, further folders, page, number of rows, sentences.
type Written = (String, String, Vec<String>, Option<String>, usize, Vec<String>);

/// A folder in the charge of this process.
#[pyclass(frozen, module = "whorl._native")]
pub struct Held(Mutex<Option<Hold>>);

#[pymethods]
impl Held {
    /// Lets another process take charge.
    fn release(&self) {
        drop(self.0.lock().unwrap_or_else(PoisonError::into_inner).take());
    }
}
