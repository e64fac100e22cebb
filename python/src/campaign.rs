//! Campaigns as lists of tasks, for engines of Python.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use whorl_campaign::Plan;
use whorl_campaign::work::{Folder, run};
use whorl_commands::campaign::{opened, planned, write_tables};

use crate::errors::error;
use crate::watch::watched;

/// A campaign file with its folder.
#[pyclass(frozen, module = "whorl._native")]
pub struct Campaign {
    plan: Arc<Plan>,
    folder: Folder,
}

#[pymethods]
impl Campaign {
    #[new]
    #[pyo3(signature = (file, out, params=None, seeds=None))]
    fn new(file: PathBuf, out: PathBuf, params: Option<PathBuf>, seeds: Option<u64>) -> PyResult<Self> {
        let plan = planned(&file, params.as_deref(), seeds).map_err(error)?;
        let folder = opened(&out, &plan).map_err(error)?;
        Ok(Self { plan: Arc::new(plan), folder })
    }

    fn __len__(&self) -> usize {
        usize::try_from(self.plan.len()).unwrap_or(usize::MAX)
    }

    /// Runs that have no row yet.
    fn missing(&self) -> Vec<u64> {
        (0..self.plan.len()).filter(|index| !self.folder.has(*index)).collect()
    }

    /// Simulates a run and stores its row, unless it has one.
    fn run(&self, py: Python<'_>, index: u64) -> PyResult<()> {
        if index >= self.plan.len() {
            return Err(error(format!("run {index}: allowed: 0 to {}", self.plan.len() - 1)));
        }
        if self.folder.has(index) {
            return Ok(());
        }
        let (plan, folder) = (Arc::clone(&self.plan), self.folder.clone());
        watched(py, None, move |_| Ok(run(&folder, &plan, index)?))
    }

    /// Writes the tables of what is done: CSV, folder of Parquet files, page; and how many rows they have.
    fn write_tables(&self) -> PyResult<(PathBuf, PathBuf, PathBuf, usize)> {
        let rows = self.folder.rows(&self.plan).map_err(error)?;
        let tables = write_tables(&self.folder, &self.plan, &rows).map_err(error)?;
        Ok((tables.csv, tables.parquet, tables.page, rows.len()))
    }
}
