//! Results as Parquet files in hive-partitioned folders ([`whorl_tables`]).

use std::path::{Path, PathBuf};

use serde_json::Value;
use whorl_bag::Channel;
use whorl_recording::{Recording, column_names};
use whorl_tables::{Table, TableError, Values, partition};

/// Numbers of a candidate, in JSON and tables.
pub const CANDIDATE_NUMBERS: [&str; 5] =
    ["delta_log_evidence", "held_out_gain", "share_of_excess", "swallowed_by_base", "detectability"];

/// A file that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenTable {
    /// Which.
    pub path: PathBuf,
    /// What it holds: a channel.
    pub holds: String,
    /// Its rows.
    pub rows: usize,
}

/// Writes one file for each channel of a recording: `<channel>/run=<name>/platform=<name>/samples.parquet`, with the
/// columns of a CSV export in SI units, and of the jets `jets/...`, a row to each pulse. `wheels` and `jets` name the
/// platform's; without names they are numbered.
///
/// # Errors
/// When a file cannot be written.
pub fn write_recording(
    recording: &Recording,
    wheels: &[String],
    jets: &[String],
    folder: &Path,
) -> Result<Vec<WrittenTable>, TableError> {
    let mut written = Vec::new();
    let part = partition(&[("run", recording.name.as_str()), ("platform", recording.platform.as_str())]);
    let mut write = |holds: String, table: Table| -> Result<(), TableError> {
        let path = folder.join(&holds).join(&part).join("samples.parquet");
        table.write(&path)?;
        written.push(WrittenTable { path, holds, rows: table.rows() });
        Ok(())
    };
    for (channel, sensor, series) in recording.sampled() {
        let count = series.numbers(0).len();
        let times = series.time_s().to_vec();
        let samples = times.len();
        let mut table = Table::default().with("time_s", Values::Numbers(times));
        for (index, name) in column_names(channel, sensor, count, wheels).into_iter().enumerate() {
            // Not measured is not zero.
            let lacks = recording.lacks(channel).get(index) == Some(&true);
            let number = |k| series.number(k, index).filter(|_| !lacks).unwrap_or(f64::NAN);
            table = table.with(name, Values::Numbers((0..samples).map(number).collect()));
        }
        let key = channel.info().key;
        let holds = if channel.most_sensors() > 1 { format!("{key}_{}", sensor + 1) } else { key.to_owned() };
        let mut table = table.noting("channel", &holds).noting("unit", channel.unit());
        if let Some(vector) = recording.vectors.get(sensor).filter(|_| channel.most_sensors() > 1) {
            let r = vector.reference_world;
            table = table.noting("reference_world", format!("[{:?}, {:?}, {:?}]", r.x, r.y, r.z));
        }
        write(holds, table)?;
    }
    if !recording.jet_pulses.is_empty() {
        let name = |j: usize| jets.get(j).cloned().unwrap_or_else(|| format!("jet_{}", j + 1));
        let pulses = recording.jet_pulses.iter().enumerate();
        let all: Vec<_> = pulses.flat_map(|(j, of)| of.iter().map(move |pulse| (j, pulse))).collect();
        let table = Table::default()
            .with("jet", Values::Texts(all.iter().map(|(j, _)| name(*j)).collect()))
            .with("on_s", Values::Numbers(all.iter().map(|(_, pulse)| pulse.on_s).collect()))
            .with("off_s", Values::Numbers(all.iter().map(|(_, pulse)| pulse.off_s).collect()));
        write(Channel::Jets.info().key.to_owned(), table)?;
    }
    Ok(written)
}

/// Writes the candidates of a diagnosis, a row to each: `platform=<name>/run=<name>/candidates.parquet`. `answer` is its JSON;
/// runs that were diagnosed together are joined by `+`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_diagnosis(
    answer: &Value,
    platform: &str,
    runs: &[&str],
    folder: &Path,
) -> Result<WrittenTable, TableError> {
    let none = Vec::new();
    let candidates = answer.get("candidates").and_then(Value::as_array).unwrap_or(&none);
    let named = answer.get("effects").and_then(Value::as_array).unwrap_or(&none);
    let text = |of: &Value, key: &str| of.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    let numbers = |key: &str| {
        let number = |of: &Value| of.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN);
        Values::Numbers(candidates.iter().map(number).collect())
    };
    let verdict = text(answer, "verdict");
    let mut table = Table::default()
        .with("verdict", Values::Texts(vec![verdict; candidates.len()]))
        .with("effect", Values::Texts(candidates.iter().map(|c| text(c, "effect")).collect()))
        .with(
            "named",
            Values::Truths(
                candidates.iter().map(|c| c.get("effect").is_some_and(|id| named.contains(id))).collect(),
            ),
        );
    for key in CANDIDATE_NUMBERS {
        table = table.with(key, numbers(key));
    }
    // Effects differ in their parameters: a text that every reader takes apart.
    let parameters = candidates.iter().map(|c| c.get("parameters").map(Value::to_string).unwrap_or_default());
    let table = table.with("parameters_json", Values::Texts(parameters.collect()));
    let part = partition(&[("platform", platform), ("run", &runs.join("+"))]);
    let path = folder.join(part).join("candidates.parquet");
    table.write(&path)?;
    Ok(WrittenTable { path, holds: "candidates".to_owned(), rows: table.rows() })
}
