//! Answers to the question of a campaign over recordings, and their tables.

use std::f64::consts::FRAC_PI_2;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};
use whorl_bag::CsvMap;
use whorl_campaign::recordings::{Item, Question, RecordingsDefinition};
use whorl_campaign::work::Folder;
use whorl_explain::{ExplainError, compare};
use whorl_identification::Options;
use whorl_recording::Recording;
use whorl_tables::{Table, TableError, Values, partition};

use crate::attitudes::{
    Tally, lines_of, lines_of_csv, recorded_by, recorded_in, table as attitude_table, told,
};
use crate::estimate::{Chosen, EstimateOptions, estimates};
use crate::runs::{RunSources, Runs, is_csv};
use crate::{compare as comparison, diagnose as diagnosis};

/// A direction with a smaller level part says nothing about the heading.
const LEAST_LEVEL: f64 = 1e-3;

/// The campaign's own folder cannot be written, which is no fault of the recording.
#[derive(Debug)]
pub struct Unwritten(TableError);

impl fmt::Display for Unwritten {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl std::error::Error for Unwritten {}

/// What is asked of each recording.
pub struct Asked<'a> {
    /// The campaign's file.
    pub definition: &'a RecordingsDefinition,
    /// The platform's parameter file; `None`: each recording's own.
    pub model: Option<PathBuf>,
    /// Map of the columns of CSV files.
    pub channels: Option<PathBuf>,
    /// Effects that the diagnosis leaves out.
    pub excluded: Vec<String>,
}

/// The answer to the question as JSON; the recording is read from `path`.
///
/// # Errors
/// Why there is none; [`Unwritten`] where the campaign's folder cannot be written.
pub fn answer(asked: &Asked<'_>, folder: &Folder, item: &Item, path: &Path) -> anyhow::Result<Value> {
    let source = RunSources {
        runs: vec![path.to_owned()],
        held_out: Vec::new(),
        model: asked.model.clone(),
        platform: item.platform.clone(),
        channels: asked.channels.clone(),
    };
    match asked.definition.question {
        Question::Compare => compared(&source.read()?, asked.definition.refit),
        Question::Diagnose => diagnosed(&source.read()?, asked.excluded.clone()),
        Question::Estimate => estimated(asked, folder, item, &source, path),
    }
}

fn compared(runs: &Runs, refit: bool) -> anyhow::Result<Value> {
    let (compared, given) = if refit {
        let (given, refitted) = comparison::refitted(&runs.case(), &mut |_, _| ())?;
        (refitted, Some(given))
    } else {
        (compare(&runs.case(), &mut |_, _| ())?, None)
    };
    comparison::as_json(&runs.known.platform, &compared, given.as_deref())
}

fn diagnosed(runs: &Runs, exclude: Vec<String>) -> anyhow::Result<Value> {
    // The other processors have other recordings. What to record next is of no use for runs of long ago.
    let options = Options { exclude, threads: 1, ..Options::default() };
    let found = whorl_explain::diagnose(&runs.case(), &options, &mut |_, _| ())
        .map_err(|error: ExplainError| anyhow::Error::from(error))?;
    let mut value = diagnosis::as_json(&found)?;
    if let (Some(object), Some(run)) = (value.as_object_mut(), runs.training.first()) {
        object.insert("platform".to_owned(), json!(runs.known.platform));
        object.insert("duration_s".to_owned(), json!(run.duration_s()));
        object.insert("answer".to_owned(), json!(found.answer()));
    }
    Ok(value)
}

fn estimated(
    asked: &Asked<'_>,
    folder: &Folder,
    item: &Item,
    source: &RunSources,
    path: &Path,
) -> anyhow::Result<Value> {
    let of = asked.definition;
    let options =
        EstimateOptions { filter: of.filter.clone(), smooth: of.smooth, ..EstimateOptions::default() };
    let (recorded, lines, late_s, north, platform) = if is_csv(path) {
        let map = source.channels.as_deref().with_context(|| {
            format!(
                "{}: a CSV file needs a map of its columns: `channels` in the campaign's file",
                path.display()
            )
        })?;
        let columns = CsvMap::load(map)?;
        let recorded = recorded_by(&columns, map);
        let needs_force = Chosen::new(&options, &recorded)?.needs_force();
        let platform = item.platform.clone().unwrap_or_default();
        (
            recorded,
            lines_of_csv(path, &columns, needs_force)?,
            columns.imu_latency_s,
            UnitQuaternion::identity(),
            platform,
        )
    } else {
        let runs = source.read()?;
        let recording = runs.training.first().context("no recording")?;
        let recorded = recorded_in(recording);
        let needs_force = Chosen::new(&options, &recorded)?.needs_force();
        (recorded, lines_of(recording, needs_force)?, 0.0, north_of(recording), runs.known.platform.clone())
    };
    let samples: Vec<_> = lines.iter().map(|line| line.sample.clone()).collect();
    let (chosen, found) = estimates(&options, &recorded, &samples)?;
    let first_ns = samples.first().map_or(0, |sample| sample.stamp_ns);
    let last_ns = samples.last().map_or(0, |sample| sample.stamp_ns);
    // Filters that know no reference take the first sensor's for magnetic north.
    let north = if chosen.knows_references() { UnitQuaternion::identity() } else { north };
    let (mut tally, mut attitudes) = (Tally::default(), Vec::new());
    for (line, estimate) in lines.iter().zip(found) {
        let Some(estimate) = estimate else { continue };
        let estimate = told(estimate, &line.sample, &north, late_s);
        tally.add(&estimate, line.truth.as_ref());
        attitudes.push((line.sample.stamp_ns, estimate));
    }
    let part = partition(&[("recording", item.recording.as_str()), ("platform", &platform)]);
    let file = folder.path().join("attitudes").join(part).join("attitudes.parquet");
    attitude_table(&attitudes, first_ns).write(&file).map_err(Unwritten)?;
    let degrees = tally.errors.root_mean_square_rad().map(|rms| rms.map(f64::to_degrees));
    let last = attitudes.last().map(|(_, orientation)| orientation);
    let bias = last.map(|o| [o.gyro_bias_rad_s.x, o.gyro_bias_rad_s.y, o.gyro_bias_rad_s.z]);
    Ok(json!({
        "platform": platform,
        "filter": chosen.name(),
        "smoothed": of.smooth,
        "samples": samples.len(),
        "attitudes": tally.estimates,
        "duration_s": (last_ns - first_ns) as f64 * 1e-9,
        "magnetised": chosen.is_magnetised(),
        "error_rms_deg": degrees.map(|[total, ..]| total),
        "heading_error_rms_deg": degrees.map(|[_, heading, _]| heading),
        "inclination_error_rms_deg": degrees.map(|[.., inclination]| inclination),
        "heading_consistency": tally.heading_consistency(),
        "sigma_heading_deg": last.map(|o| o.covariance_w_rad2()[(2, 2)].max(0.0).sqrt().to_degrees()),
        "gyro_bias_x_rad_s": bias.map(|[x, ..]| x),
        "gyro_bias_y_rad_s": bias.map(|[_, y, _]| y),
        "gyro_bias_z_rad_s": bias.map(|[.., z]| z),
    }))
}

/// The turn about the vertical from north to the azimuth of what the first vector sensor sees; none where it sees the vertical.
fn north_of(recording: &Recording) -> UnitQuaternion<f64> {
    let seen = recording.vectors.first().map(|sensor| sensor.reference_world);
    let level = seen.filter(|seen| seen.x.hypot(seen.y) > LEAST_LEVEL);
    let azimuth = level.map_or(0.0, |seen| seen.y.atan2(seen.x) - FRAC_PI_2);
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth)
}

fn text(of: &Value, key: &str) -> String {
    of.get(key).and_then(Value::as_str).unwrap_or_default().to_owned()
}

fn number(of: &Value, key: &str) -> f64 {
    of.get(key).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

fn list<'a>(of: &'a Value, key: &str) -> &'a [Value] {
    of.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn names(of: &Value, key: &str) -> String {
    list(of, key).iter().filter_map(Value::as_str).collect::<Vec<_>>().join(", ")
}

/// Verdict and effects of a row, in a line.
pub fn verdict(row: &Value) -> String {
    let of = &row["answer"];
    let (verdict, effects) = (text(of, "verdict").replace('_', " "), names(of, "effects"));
    if effects.is_empty() { verdict } else { format!("{verdict}: {effects}") }
}

/// One row to each recording.
pub fn table(question: Question, rows: &[(u64, Value)]) -> Table {
    let whole = rows.iter().map(|(index, _)| i64::try_from(*index).unwrap_or(i64::MAX));
    let texts = |key: &str| Values::Texts(rows.iter().map(|(_, row)| text(row, key)).collect());
    let told = |key: &str| Values::Texts(rows.iter().map(|(_, row)| text(&row["answer"], key)).collect());
    let listed = |key: &str| Values::Texts(rows.iter().map(|(_, row)| names(&row["answer"], key)).collect());
    let numbers = |of: &dyn Fn(&Value) -> f64| {
        Values::Numbers(rows.iter().map(|(_, row)| of(&row["answer"])).collect())
    };
    let truths = |key: &str| {
        let of = |row: &Value| row["answer"].get(key).and_then(Value::as_bool).unwrap_or(false);
        Values::Truths(rows.iter().map(|(_, row)| of(row)).collect())
    };
    let mut table = Table::default().with("number", Values::Whole(whole.collect()));
    for key in ["recording", "run", "platform", "experiment"] {
        table = table.with(key, texts(key));
    }
    let began = rows.iter().map(|(_, row)| number(row, "began_unix_s"));
    table = table.with("began_unix_s", Values::Numbers(began.collect()));
    table = table.with("outcome", texts("outcome")).with("reason", texts("reason"));
    match question {
        Question::Compare => {
            let of_first = |key: &'static str| {
                move |of: &Value| number(list(of, "runs").first().unwrap_or(&Value::Null), key)
            };
            table
                .with("duration_s", numbers(&of_first("duration_s")))
                .with("prediction_error", numbers(&|of| number(of, "prediction_error")))
                .with("prediction_error_as_given", numbers(&|of| number(of, "prediction_error_as_given")))
        }
        Question::Diagnose => {
            let version = |name: &'static str| {
                move |of: &Value| {
                    let versions = list(of, "versions");
                    let found = match name {
                        "last" => versions.last(),
                        place => versions.get(usize::from(place == "second")),
                    };
                    number(found.unwrap_or(&Value::Null), "prediction_error")
                }
            };
            table
                .with("duration_s", numbers(&|of| number(of, "duration_s")))
                .with("verdict", told("verdict"))
                .with("effects", listed("effects"))
                .with("prediction_error_as_given", numbers(&version("first")))
                .with("prediction_error_refitted", numbers(&version("second")))
                .with("prediction_error_with_effects", numbers(&version("last")))
        }
        Question::Estimate => {
            table = table
                .with("filter", told("filter"))
                .with("smoothed", truths("smoothed"))
                .with("magnetised", truths("magnetised"));
            for key in [
                "duration_s",
                "samples",
                "attitudes",
                "error_rms_deg",
                "heading_error_rms_deg",
                "inclination_error_rms_deg",
                "heading_consistency",
                "sigma_heading_deg",
                "gyro_bias_x_rad_s",
                "gyro_bias_y_rad_s",
                "gyro_bias_z_rad_s",
            ] {
                table = table.with(key, numbers(&|of| number(of, key)));
            }
            table
        }
    }
}

/// Writes the tables with several rows to a recording: candidates of diagnoses, channels of comparisons; and names the folder of
/// attitudes.
///
/// # Errors
/// When a file cannot be written.
pub fn further(
    question: Question,
    rows: &[(u64, Value)],
    folder: &Folder,
) -> Result<Vec<PathBuf>, TableError> {
    let (name, table) = match question {
        Question::Compare => ("channels", channels(rows)),
        Question::Diagnose => ("candidates", candidates(rows)),
        Question::Estimate => {
            let attitudes = folder.path().join("attitudes");
            let there = folder.has_files_in("attitudes").map_err(|source| TableError::Io {
                action: "list",
                path: attitudes.clone(),
                source,
            })?;
            return Ok(there.then_some(attitudes).into_iter().collect());
        }
    };
    let path = folder.path().join(name);
    table.write(&path.join("rows.parquet"))?;
    Ok(vec![path])
}

/// Columns that say which recording a row is of.
fn whose<'a>(rows: impl Iterator<Item = &'a (u64, Value)> + Clone) -> Table {
    let number = rows.clone().map(|(index, _)| i64::try_from(*index).unwrap_or(i64::MAX));
    let mut table = Table::default().with("number", Values::Whole(number.collect()));
    for key in ["recording", "run", "platform"] {
        table = table.with(key, Values::Texts(rows.clone().map(|(_, row)| text(row, key)).collect()));
    }
    table
}

fn candidates(rows: &[(u64, Value)]) -> Table {
    let all: Vec<(&(u64, Value), &Value)> = rows
        .iter()
        .flat_map(|row| list(&row.1["answer"], "candidates").iter().map(move |c| (row, c)))
        .collect();
    let texts = |of: &dyn Fn(&Value) -> String| Values::Texts(all.iter().map(|(_, c)| of(c)).collect());
    let named = all.iter().map(|(row, c)| list(&row.1["answer"], "effects").contains(&c["effect"]));
    let mut table = whose(all.iter().map(|(row, _)| *row))
        .with(
            "verdict",
            Values::Texts(all.iter().map(|(row, _)| text(&row.1["answer"], "verdict")).collect()),
        )
        .with("effect", texts(&|c| text(c, "effect")))
        .with("named", Values::Truths(named.collect()));
    for key in crate::tables::CANDIDATE_NUMBERS {
        table = table.with(key, Values::Numbers(all.iter().map(|(_, c)| number(c, key)).collect()));
    }
    table.with("parameters_json", texts(&|c| c.get("parameters").map(Value::to_string).unwrap_or_default()))
}

fn channels(rows: &[(u64, Value)]) -> Table {
    let mut all: Vec<(&(u64, Value), &Value, &Value)> = Vec::new();
    for row in rows {
        for channel in list(&row.1["answer"], "runs").iter().flat_map(|run| list(run, "channels")) {
            all.extend(list(channel, "horizons").iter().map(|horizon| (row, channel, horizon)));
        }
    }
    let of_channel =
        |key: &str| Values::Texts(all.iter().map(|(_, channel, _)| text(channel, key)).collect());
    let mut table = whose(all.iter().map(|(row, ..)| *row))
        .with("channel", of_channel("name"))
        .with("unit", of_channel("unit"))
        .with("noise_floor", Values::Numbers(all.iter().map(|(_, c, _)| number(c, "noise_floor")).collect()));
    // The horizon is null for the whole run.
    for key in ["horizon_s", "rms", "predicted_stddev", "ratio", "fit_percent"] {
        table =
            table.with(key, Values::Numbers(all.iter().map(|(.., horizon)| number(horizon, key)).collect()));
    }
    table
}
