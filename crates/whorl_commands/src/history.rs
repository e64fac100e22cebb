//! Answers of `history`: how a model came to be, and what changed from run to run; as data, sentences and tables.

use std::path::Path;

use anyhow::Context as _;
use serde_json::json;
use whorl_bag::RunDirectory;
use whorl_explain::trends::{Change, Trend, Trends};
use whorl_math::three_digits;
use whorl_params::ModelStep;
use whorl_recording::KnownPlatform;
use whorl_tables::{Table, TableError, Values, partition};

use crate::tables::WrittenTable;

/// Version of the JSON output.
const SCHEMA: u32 = 2;
/// A change that is told: one in a hundred of histories without any tells one.
const TOLD: f64 = 0.01;
/// Headings of [`rows`], with `#` before those of numbers.
pub const HEADINGS: [&str; 9] =
    ["effect", "parameter", "unit", "#runs", "#scatter", "changed at", "#by", "#+-", "#chance"];

/// When a run began \[s since 1970\]: as its manifest says, else when its file was written.
///
/// # Errors
/// When neither is known.
pub fn began_s(path: &Path) -> anyhow::Result<f64> {
    if let Ok(manifest) = RunDirectory::open(path).and_then(|run| run.manifest_or_from_bag()) {
        return Ok(manifest.start_utc.0 as f64 * 1e-9);
    }
    let written = std::fs::metadata(path)
        .and_then(|file| file.modified())
        .with_context(|| format!("{}: when it began is not known", path.display()))?;
    Ok(written.duration_since(std::time::UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64()))
}

/// What changed, in sentences.
#[must_use]
pub fn sentences(found: &Trends) -> Vec<String> {
    let mut told: Vec<String> = found
        .trends
        .iter()
        .filter_map(|trend| Some((trend, trend.change.as_ref().filter(|change| change.chance < TOLD)?)))
        .map(|(trend, change)| {
            let unit = if trend.unit == "1" { String::new() } else { format!(" {}", trend.unit) };
            let (size, stddev) = (three_digits(change.size), three_digits(change.stddev));
            let name = format!("{} {}", trend.group, trend.name);
            let sure = format!("{:.1} sigma after all that was looked at", change.sigma_after);
            let run = found.runs.get(change.from).map_or("?", |(run, _)| run.as_str());
            format!("Since {run}: {name} has changed by {size} +- {stddev}{unit}, {sure}.")
        })
        .collect();
    if told.is_empty() {
        told.push(format!(
            "Nothing has changed beyond chance in {} runs ({} tests).",
            found.runs.len() - found.left_out.len(),
            found.tests
        ));
    }
    told.extend(found.left_out.iter().map(|(run, why)| format!("{run} was left out: {why}.")));
    told
}

/// A row to each parameter, for tables.
#[must_use]
pub fn rows(found: &Trends) -> Vec<Vec<String>> {
    let row = |trend: &Trend| {
        let change = trend.change.as_ref();
        let from = change.and_then(|change| found.runs.get(change.from));
        let from = from.map_or_else(String::new, |(run, _)| run.clone());
        let number = |of: fn(&Change) -> f64| change.map_or_else(String::new, |c| three_digits(of(c)));
        vec![
            trend.group.clone(),
            trend.name.clone(),
            trend.unit.clone(),
            trend.estimates.len().to_string(),
            format!("{:.2}", trend.scatter),
            from,
            number(|c| c.size),
            number(|c| c.stddev),
            number(|c| c.chance),
        ]
    };
    found.trends.iter().map(row).collect()
}

/// What changed from run to run.
#[must_use]
pub fn trends_as_json(found: &Trends) -> serde_json::Value {
    let trend = |trend: &Trend| {
        let estimates: Vec<_> = trend
            .estimates
            .iter()
            .map(|e| json!({"run": e.run, "value": e.value, "stddev": e.stddev}))
            .collect();
        let change = trend.change.as_ref().map(|c| {
            json!({"from_run": c.from, "size": c.size, "stddev": c.stddev, "sigma": c.sigma,
               "chance": c.chance, "sigma_after": c.sigma_after})
        });
        json!({"group": trend.group, "name": trend.name, "unit": trend.unit, "model": trend.model,
           "scatter": trend.scatter, "estimates": estimates, "change": change})
    };
    let runs: Vec<_> =
        found.runs.iter().map(|(name, began_s)| json!({"name": name, "began_unix_s": began_s})).collect();
    let left: Vec<_> = found.left_out.iter().map(|(run, why)| json!({"run": run, "why": why})).collect();
    json!({"schema": SCHEMA, "runs": runs, "tests": found.tests, "left_out": left,
       "parameters": found.trends.iter().map(trend).collect::<Vec<_>>()})
}

/// How a model came to be.
#[must_use]
pub fn as_json(known: &KnownPlatform) -> serde_json::Value {
    let step = |step: &ModelStep| {
        json!({"number": step.number, "date": step.date, "effects": step.effects,
           "prediction_error": step.prediction_error,
           "held_out_prediction_error": step.held_out_prediction_error, "source": step.source})
    };
    let steps: Vec<_> = known.history.iter().map(step).collect();
    json!({"schema": SCHEMA, "platform": known.platform, "steps": steps})
}

/// Writes every estimate of every parameter, a row to each: `platform=<name>/history.parquet`, with the run it is of, when that
/// began, and the change that was found in the parameter.
///
/// # Errors
/// When the file cannot be written.
pub fn write_table(found: &Trends, platform: &str, folder: &Path) -> Result<WrittenTable, TableError> {
    let all: Vec<_> =
        found.trends.iter().flat_map(|trend| trend.estimates.iter().map(move |e| (trend, e))).collect();
    let run = |index: usize| found.runs.get(index);
    let numbers = |of: &dyn Fn(&Trend) -> Option<f64>| {
        Values::Numbers(all.iter().map(|(trend, _)| of(trend).unwrap_or(f64::NAN)).collect())
    };
    let texts =
        |of: &dyn Fn(&Trend) -> String| Values::Texts(all.iter().map(|(trend, _)| of(trend)).collect());
    let name = |index: usize| run(index).map(|(name, _)| name.clone()).unwrap_or_default();
    let from = |trend: &Trend| trend.change.as_ref().map_or_else(String::new, |change| name(change.from));
    let began = all.iter().map(|(_, e)| run(e.run).map_or(f64::NAN, |(_, began_s)| *began_s));
    let table = Table::default()
        .with("run", Values::Texts(all.iter().map(|(_, e)| name(e.run)).collect()))
        .with("began_unix_s", Values::Numbers(began.collect()))
        .with("effect", texts(&|trend| trend.group.clone()))
        .with("parameter", texts(&|trend| trend.name.clone()))
        .with("unit", texts(&|trend| trend.unit.clone()))
        .with("value", Values::Numbers(all.iter().map(|(_, e)| e.value).collect()))
        .with("stddev", Values::Numbers(all.iter().map(|(_, e)| e.stddev).collect()))
        .with("model", numbers(&|trend| Some(trend.model)))
        .with("scatter", numbers(&|trend| Some(trend.scatter)))
        .with("change_from_run", texts(&from))
        .with("change_by", numbers(&|trend| Some(trend.change.as_ref()?.size)))
        .with("change_stddev", numbers(&|trend| Some(trend.change.as_ref()?.stddev)))
        .with("chance", numbers(&|trend| Some(trend.change.as_ref()?.chance)));
    let path = folder.join(partition(&[("platform", platform)])).join("history.parquet");
    table.write(&path)?;
    Ok(WrittenTable { path, holds: "history".to_owned(), rows: table.rows() })
}
