//! Simulated experiments.

use std::path::PathBuf;

use anyhow::bail;
use pyo3::prelude::*;
use whorl_commands::report;
use whorl_commands::simulate::{Record, Simulation, utc_now};

use crate::watch::watched;

/// Simulates an experiment into a run directory: its path, and the numbers and the verdict of its report as JSON.
#[pyfunction]
#[pyo3(signature = (experiment, out=None, seed=1, params=None, overrides=vec![], longest_s=3600.0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "the arguments of a Python function")]
pub fn simulate(
    py: Python<'_>,
    experiment: PathBuf,
    out: Option<PathBuf>,
    seed: u64,
    params: Option<PathBuf>,
    overrides: Vec<String>,
    longest_s: f64,
    progress: Option<Py<PyAny>>,
) -> PyResult<(PathBuf, String)> {
    watched(py, progress, move |say| {
        if !(longest_s > 0.0 && longest_s.is_finite()) {
            bail!("longest_s is {longest_s}; allowed: a positive number of seconds");
        }
        let record = out.map_or_else(|| Record::Beneath(PathBuf::from("runs")), Record::Into);
        let simulation = Simulation { experiment, record, seed, params, overrides, longest_s };
        // How long an experiment takes is known when it has ended.
        let mut simulated = |at_s: f64| say(0.0, &format!("simulated {at_s:.0} s"));
        let done = simulation.run(false, utc_now, &mut simulated)?;
        let Some(path) = done.path else { bail!("nothing was recorded") };
        say(0.9, "writing the report");
        let written = report::write(&path, None)?;
        let mut json = serde_json::to_value(&written.summary)?;
        if let Some(object) = json.as_object_mut() {
            object.insert("verdict".to_owned(), serde_json::to_value(&written.verdict)?);
            object.insert("simulated_s".to_owned(), done.outcome.simulated_s.into());
            object.insert("finished".to_owned(), done.outcome.finished.into());
        }
        Ok((path, json.to_string()))
    })
}
