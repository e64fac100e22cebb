//! What changed from run to run, how a model came to be, and errors of sensors: JSON texts.

use std::path::PathBuf;

use anyhow::{Context, bail};
use pyo3::prelude::*;
use whorl_calibration::calibrate_imu;
use whorl_commands::history::{HEADINGS, as_json, began_s, rows, sentences, trends_as_json, write_table};
use whorl_commands::{calibrate as calibration, model_file, options, simulate::utc_now};
use whorl_explain::changes::of_calibration;
use whorl_explain::trends::trends as over_runs;
use whorl_params::ModelStep;

use crate::explain::{Given, Material, material};
use crate::platform::Platform;
use crate::watch::watched;

/// What changed from run to run: JSON, sentences, headings and rows of the table, page, and the Parquet file.
type Changed = (String, Vec<String>, Vec<String>, Vec<Vec<String>>, String, Option<PathBuf>);

/// Parameters over runs. `began`: when each began [s since 1970]; without, as its manifest says. `since`: place of the run
/// from which on others are compared.
#[pyfunction]
#[pyo3(signature = (training, platform, began=None, since=None, parquet=None, progress=None))]
pub fn trends(
    py: Python<'_>,
    training: Given<'_>,
    platform: &Bound<'_, Platform>,
    began: Option<Vec<f64>>,
    since: Option<usize>,
    parquet: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Changed> {
    let Material { runs, .. } = material(&training, &[], platform, "history")?;
    let sources: Vec<(String, Option<PathBuf>)> =
        training.iter().map(|r| (r.get().inner.name.clone(), r.get().source.clone())).collect();
    watched(py, progress, move |say| {
        let began = match began {
            Some(given) if given.len() != sources.len() => {
                bail!(
                    "began_unix_s has {} times; allowed: one to each of the {} runs",
                    given.len(),
                    sources.len()
                )
            }
            Some(given) => match given.iter().find(|time| !time.is_finite()) {
                Some(wrong) => bail!("began_unix_s: {wrong}; allowed: finite numbers"),
                None => given,
            },
            None => sources
                .iter()
                .map(|(name, source)| {
                    let path = source.as_ref().with_context(|| {
                        format!("{name} is in memory: when it began is not known; give began_unix_s")
                    })?;
                    began_s(path)
                })
                .collect::<anyhow::Result<Vec<f64>>>()?,
        };
        let dated: Vec<_> = runs.training.iter().zip(began.iter().copied()).collect();
        let since = match since {
            None => None,
            Some(place) => {
                let from = began.get(place).with_context(|| format!("there is no run {place}"))?;
                Some(began.iter().filter(|other| *other < from).count())
            }
        };
        let (model, prior) = (&runs.known.model, &runs.known.prior);
        let found = over_runs(&dated, model, prior, since, &options(), say)?;
        let (answer, rows) = (sentences(&found), rows(&found));
        let table = parquet.map(|folder| write_table(&found, &runs.known.platform, &folder)).transpose()?;
        let page = whorl_report::trends_html(&found, &answer, &HEADINGS, &rows, &runs.facts);
        let headings = HEADINGS.map(|heading| heading.trim_start_matches('#').to_owned()).to_vec();
        let json = trends_as_json(&found).to_string();
        Ok((json, answer, headings, rows, page, table.map(|table| table.path)))
    })
}

/// How a platform's model came to be: JSON.
#[pyfunction]
pub fn history(platform: &Bound<'_, Platform>) -> String {
    as_json(&platform.get().0).to_string()
}

/// Errors of gyro and accelerometer: JSON, and how many entries were written into `out`.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments of a Python function")]
#[pyo3(signature = (training, platform, known_turn_deg=None, turn_error_deg=0.3, level_error_deg=0.5, gravity_m_s2=None, out=None))]
pub fn calibrate_sensors(
    py: Python<'_>,
    training: Given<'_>,
    platform: &Bound<'_, Platform>,
    known_turn_deg: Option<f64>,
    turn_error_deg: f64,
    level_error_deg: f64,
    gravity_m_s2: Option<f64>,
    out: Option<PathBuf>,
) -> PyResult<(String, Option<usize>)> {
    let Material { runs, source } = material(&training, &[], platform, "whorl.calibrate in Python")?;
    watched(py, None, move |_| {
        let settings = calibration::settings(known_turn_deg, turn_error_deg, level_error_deg, gravity_m_s2)?;
        let recordings: Vec<_> = runs.training.iter().collect();
        let found = calibrate_imu(&recordings, &runs.known.model.sensors, &settings);
        let fatal = found.findings.iter().find(|finding| finding.fatal);
        let written = match (&out, fatal) {
            (None, _) => None,
            (Some(_), Some(finding)) => bail!("nothing was written: {}", finding.text),
            (Some(out), None) => {
                let step = ModelStep::of_source(source);
                model_file::prepare_out(out, &runs.known)?;
                Some(model_file::write_step(out, &runs.known, &of_calibration(&found), step, utc_now())?)
            }
        };
        Ok((calibration::as_json(&runs.known.platform, &found).to_string(), written))
    })
}
