//! The campaign file: a parameter file of a node `/campaign`.

use whorl_math::words::or_did_you_mean;
use whorl_params::{Entry, Reader, Value, positive, range};

use crate::row::METRICS;

/// What a campaign sweeps.
#[derive(Debug, Clone, PartialEq)]
pub struct Definition {
    /// Its name.
    pub name: String,
    /// Experiment files, relative to the parameter folder's `experiments/`; the first axis.
    pub experiments: Vec<String>,
    /// First seed.
    pub first_seed: u64,
    /// How many seeds.
    pub seeds: u64,
    /// Axes of the sweep; every combination is run with every seed.
    pub axes: Vec<Axis>,
    /// Overrides of all runs, `node:key:=value`.
    pub always: Vec<String>,
    /// Longest simulated time of a run \[s\].
    pub longest_s: f64,
    /// Every run whose number is a multiple of this is recorded as a run directory; 0: none.
    pub keep_every: u64,
    /// Metrics of the percentile plots.
    pub plots: Vec<String>,
}

/// One swept quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Its name, a column of the table.
    pub name: String,
    /// Its values.
    pub choices: Vec<Choice>,
}

/// One value of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Label in the table.
    pub label: String,
    /// Overrides, `node:key:=value`.
    pub overrides: Vec<String>,
}

/// Reads a campaign. Errors stay in the reader.
pub fn read(r: &mut Reader<'_>) -> Definition {
    let name = r.string_or("name", "campaign", "name of the campaign");
    let experiments =
        r.string_array("experiments", "names of experiments in the parameter folder's experiments/");
    if experiments.is_empty() && r.has("experiments") {
        r.reject("experiments", "the list is empty; allowed: at least one experiment");
    }
    let first_seed = r.i64_or("first_seed", 1, range(0..), "first seed of the noise");
    let seeds = r.i64_or("seeds", 1, range(1..=1_000_000), "how many seeds, counted up from the first");
    let axes = r
        .children("sweep")
        .iter()
        .map(|axis| r.group(&format!("sweep.{axis}"), |r| read_axis(r, axis)))
        .collect();
    let plots = r.string_array_or(
        "plots",
        &["relative_error_rms_deg", "gas_used_g"],
        "metrics of the percentile plots: columns of the table",
    );
    for metric in plots.iter().filter(|metric| !METRICS.contains(&metric.as_str())) {
        let likely = or_did_you_mean(metric, METRICS.iter().copied());
        r.reject("plots", format!("there is no metric `{metric}`; allowed: {}{likely}", METRICS.join(", ")));
    }
    Definition {
        name,
        experiments,
        first_seed: first_seed.unsigned_abs(),
        seeds: seeds.unsigned_abs(),
        axes,
        always: r.string_array_or("always", &[], "overrides of every run, each `node:key:=value`"),
        longest_s: r.f64_or("longest_s", 3600.0, positive(), "longest simulated time of a run [s]"),
        keep_every: r
            .i64_or(
                "keep_every",
                0,
                range(0..),
                "one in this many runs is recorded as a run directory; 0: none",
            )
            .unsigned_abs(),
        plots,
    }
}

fn read_axis(r: &mut Reader<'_>, name: &str) -> Axis {
    let choices = if r.has("cases") { read_cases(r) } else { read_values(r, name) };
    if choices.is_empty() {
        r.reject("values", "nothing to sweep; allowed: at least one value");
    }
    Axis { name: name.to_owned(), choices }
}

/// `cases: {name: [override, ...], ...}`.
fn read_cases(r: &mut Reader<'_>) -> Vec<Choice> {
    r.children("cases")
        .into_iter()
        .map(|label| {
            let key = format!("cases.{label}");
            let overrides =
                r.string_array(&key, "overrides of this case, each `node:key:=value`; [] for none");
            Choice { label, overrides }
        })
        .collect()
}

/// `key: "node:key"`, `values: [...]` of numbers, texts or truth values.
fn read_values(r: &mut Reader<'_>, axis: &str) -> Vec<Choice> {
    let key = r.string("key", "what is swept, as `node:key`");
    let name = format!("sweep.{axis}.values");
    let texts: Vec<String> = match r.parameters().get(&name).map(|Entry { value, .. }| value.clone()) {
        Some(Value::DoubleArray(_) | Value::IntegerArray(_)) => {
            let integers =
                matches!(r.parameters().get(&name).map(|e| &e.value), Some(Value::IntegerArray(_)));
            if integers {
                let values = r.i64_array("values", range(..), "values to sweep");
                values.iter().map(ToString::to_string).collect()
            } else {
                let values = r.f64_array("values", range(..), "values to sweep");
                values.iter().map(|v| format!("{v:?}")).collect()
            }
        }
        _ => r.string_array("values", "values to sweep"),
    };
    texts.into_iter().map(|label| Choice { overrides: vec![format!("{key}:={label}")], label }).collect()
}
