//! Campaigns over experiments: simulated runs.

use anyhow::Context;
use serde_json::{Map, Value, json};
use whorl_campaign::work::{Folder, Tasks};
use whorl_campaign::{Plan, RunSpec, page, table};

use super::Tables;

/// Runs that did not finish and are told one by one.
const MOST_TOLD: usize = 5;

/// Fingerprint of the plan and the parameter files, so that a folder is not continued with another campaign.
pub fn fingerprint(plan: &Plan) -> anyhow::Result<String> {
    let mut text = format!("whorl {}\n", env!("CARGO_PKG_VERSION"));
    let first_of_each = plan.len().div_euclid(plan.definition.experiments.len().max(1) as u64).max(1);
    for k in 0..plan.definition.experiments.len() as u64 {
        for layer in plan.run(k * first_of_each).map(|spec| spec.layers).unwrap_or_default() {
            let content =
                whorl_files::read_text(&layer).with_context(|| format!("cannot read {}", layer.display()))?;
            // Not its folder: the same campaign may be given by other spellings of its paths.
            let name = layer.file_name().unwrap_or_default().to_string_lossy();
            text.push_str(&format!("# {name}\n{content}\n"));
        }
    }
    text.push_str(&format!("{:#?}\n", plan.definition));
    Ok(text)
}

/// Every run in a line.
pub fn lines(plan: &Plan) -> Vec<String> {
    let line = |index| {
        let spec = plan.run(index)?;
        Some(format!("{index:6}  {}  seed {}  {}", spec.experiment, spec.seed, spec.labels.join("  ")))
    };
    (0..plan.len()).map_while(line).collect()
}

/// Every run as data: what was swept by its name.
pub fn as_json(plan: &Plan) -> Vec<Value> {
    let axes = || plan.definition.axes.iter().map(|axis| axis.name.clone());
    let runs = (0..plan.len()).map_while(|index| plan.run(index));
    let run = |spec: RunSpec| {
        let swept: Map<String, Value> = axes().zip(spec.labels.into_iter().map(Value::from)).collect();
        json!({"run": spec.index, "experiment": spec.experiment, "seed": spec.seed, "swept": swept})
    };
    runs.map(run).collect()
}

/// Writes tables and page of what is done into the campaign's folder.
pub fn write_tables(folder: &Folder, plan: &Plan) -> anyhow::Result<Tables> {
    let rows = plan.rows(folder)?;
    let csv = folder.path().join("summary.csv");
    whorl_files::write_file(&csv, table::csv_text(plan, &rows))
        .with_context(|| format!("cannot write {}", csv.display()))?;
    let parquet = folder.path().join("table");
    table::write_parquet(plan, &rows, &parquet)?;
    let page = folder.path().join("percentiles.html");
    whorl_files::write_file(&page, page::html(plan, &table::groups(&rows)))
        .with_context(|| format!("cannot write {}", page.display()))?;

    let simulated_s: f64 = rows.iter().filter_map(|r| r.metrics.first()).filter(|v| v.is_finite()).sum();
    let mut said = vec![format!("{simulated_s:.0} s simulated in all")];
    let unfinished: Vec<_> = rows.iter().filter(|row| row.outcome != "finished").collect();
    said.extend(unfinished.iter().take(MOST_TOLD).map(|row| {
        let labels = row.labels.join(", ");
        format!(
            "run {} ({}, seed {}, {labels}): {}: {}",
            row.index, row.experiment, row.seed, row.outcome, row.reason
        )
    }));
    if unfinished.len() > MOST_TOLD {
        said.push(format!("and {} more that did not finish", unfinished.len() - MOST_TOLD));
    }
    Ok(Tables { csv, parquet, further: Vec::new(), page: Some(page), rows: rows.len(), said })
}
