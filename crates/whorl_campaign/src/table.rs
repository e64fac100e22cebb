//! All rows as CSV, and percentiles over what was swept.

use std::path::Path;

use whorl_math::statistics::quantile;
use whorl_tables::{Table, TableError, Values, partition};

use crate::plan::Plan;
use crate::row::{MEANINGS, METRICS, Row, record};

/// Percentiles that tables and plots show.
pub const PERCENTILES: [f64; 3] = [0.05, 0.5, 0.95];

/// All rows with a header.
#[must_use]
pub fn csv_text(plan: &Plan, rows: &[Row]) -> String {
    let axes = plan.definition.axes.iter().map(|a| a.name.clone());
    let header: Vec<String> = ["run", "experiment", "seed"]
        .map(str::to_owned)
        .into_iter()
        .chain(axes)
        .chain(["outcome", "reason"].map(str::to_owned))
        .chain(METRICS.map(str::to_owned))
        .collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let _ = writer.write_record(header);
    for row in rows {
        let _ = writer.write_record(record(row));
    }
    String::from_utf8(writer.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// Writes all rows as Parquet files, one for each experiment: `<folder>/experiment=<name>/rows.parquet`. What was swept is
/// a column of numbers where all its labels are numbers, else of texts.
///
/// # Errors
/// When a file cannot be written.
pub fn write_parquet(plan: &Plan, rows: &[Row], folder: &Path) -> Result<(), TableError> {
    for experiment in &plan.definition.experiments {
        let own: Vec<&Row> = rows.iter().filter(|row| row.experiment == *experiment).collect();
        let whole = |of: fn(&Row) -> u64| {
            let whole = |row: &&Row| i64::try_from(of(row)).unwrap_or(i64::MAX);
            Values::Whole(own.iter().map(whole).collect())
        };
        let texts = |of: fn(&Row) -> &String| Values::Texts(own.iter().map(|row| of(row).clone()).collect());
        let mut table =
            Table::default().with("run", whole(|row| row.index)).with("seed", whole(|row| row.seed));
        for (k, axis) in plan.definition.axes.iter().enumerate() {
            // Of the plan, not of the rows: files of a campaign that goes on must not change their types.
            let are_numbers = axis.choices.iter().all(|choice| choice.label.parse::<f64>().is_ok());
            let labels = own.iter().map(|row| row.labels.get(k).cloned().unwrap_or_default());
            table = table.with(
                axis.name.clone(),
                if are_numbers {
                    Values::Numbers(labels.map(|label| label.parse().unwrap_or(f64::NAN)).collect())
                } else {
                    Values::Texts(labels.collect())
                },
            );
        }
        table = table.with("outcome", texts(|row| &row.outcome)).with("reason", texts(|row| &row.reason));
        for (k, name) in METRICS.iter().enumerate() {
            let values = own.iter().map(|row| row.metrics.get(k).copied().unwrap_or(f64::NAN));
            table = table.with(*name, Values::Numbers(values.collect()));
        }
        for (name, meaning) in METRICS.iter().zip(MEANINGS) {
            table = table.noting(*name, meaning);
        }
        table.write(&folder.join(partition(&[("experiment", experiment.as_str())])).join("rows.parquet"))?;
    }
    Ok(())
}

/// Runs that differ only in their seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Their experiment.
    pub experiment: String,
    /// Their label on each axis.
    pub labels: Vec<String>,
    /// Number of runs.
    pub runs: usize,
    /// Number of finished runs.
    pub finished: usize,
    /// Outcome and reason of the first run that did not finish; empty if all finished.
    pub otherwise: String,
    /// Per metric: [`PERCENTILES`] over the runs that have it; NaN if none has.
    pub percentiles: Vec<[f64; 3]>,
}

/// The groups, in the order of the table.
#[must_use]
pub fn groups(rows: &[Row]) -> Vec<Group> {
    let mut keys: Vec<(&str, &[String])> = Vec::new();
    for row in rows {
        let key = (row.experiment.as_str(), row.labels.as_slice());
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    let group = |(experiment, labels): (&str, &[String])| {
        let own: Vec<&Row> =
            rows.iter().filter(|r| r.experiment == experiment && r.labels == labels).collect();
        let percentiles = (0..METRICS.len())
            .map(|k| {
                let values =
                    || own.iter().filter_map(|r| r.metrics.get(k).copied()).filter(|v| v.is_finite());
                PERCENTILES.map(|share| quantile(values(), share))
            })
            .collect();
        Group {
            experiment: experiment.to_owned(),
            labels: labels.to_vec(),
            runs: own.len(),
            finished: own.iter().filter(|r| r.outcome == "finished").count(),
            otherwise: own
                .iter()
                .find(|r| r.outcome != "finished")
                .map(|r| format!("{}: {}", r.outcome, r.reason))
                .unwrap_or_default(),
            percentiles,
        }
    };
    keys.into_iter().map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::{parse_row, row_text};

    fn row(index: u64, label: &str, value: f64) -> Row {
        let mut metrics = vec![f64::NAN; METRICS.len()];
        metrics[1] = value;
        Row {
            index,
            experiment: "e".into(),
            seed: index,
            labels: vec![label.into()],
            outcome: "finished".into(),
            reason: "a, \"b\"".into(),
            metrics,
        }
    }

    #[test]
    fn a_row_survives_its_text() {
        let before = row(7, "0.1", 1.0 / 3.0);
        let after = parse_row(&row_text(&before), 1).unwrap();
        assert_eq!(after.metrics[1].to_bits(), (1.0_f64 / 3.0).to_bits());
        assert!(after.metrics[0].is_nan());
        assert_eq!((after.index, &after.labels, &after.reason), (7, &before.labels, &before.reason));
        assert!(parse_row("1,2,3\n", 1).is_err());
    }

    #[test]
    fn percentiles_are_those_of_each_group() {
        let rows: Vec<Row> = (0..=100).map(|k| row(k, "a", k as f64)).chain([row(101, "b", 5.0)]).collect();
        let groups = groups(&rows);
        assert_eq!(groups.len(), 2);
        assert_eq!(groups[0].percentiles[1], [5.0, 50.0, 95.0]);
        assert_eq!(groups[1].percentiles[1], [5.0; 3]);
        assert!(groups[0].percentiles[0][1].is_nan());
        assert_eq!((groups[0].runs, groups[0].finished), (101, 101));
    }
}
