//! A folder with a CSV file for each sensor, as apps on phones write it: put together in one file, in which each sensor has lines of its
//! own.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::bail;
use whorl_bag::{Channel, CsvLook, LookedColumn};
use whorl_math::statistics::median;

use super::bare::by_file;
use super::names::{Axis, Meaning, named};
use super::units;
use crate::runs::write;

/// Files of a folder that are looked at.
const MOST_FILES: usize = 200;
/// Lines of a sensor's file: an hour and a half at 500 Hz.
const MOST_LINES: usize = 3_000_000;
/// A usual length within this share of gravity is that of an accelerometer from which nobody has taken gravity \[1\].
const NEAR: f64 = 0.25;
/// What the files of a bag or a run are called, or end in.
const OF_BAGS: [&str; 6] = ["metadata.yaml", "manifest.yaml", "mcap", "db3", "zstd", "zst"];

/// One sensor's file.
struct Sensor {
    name: String,
    channel: Channel,
    times: Vec<f64>,
    axes: [Vec<f64>; 3],
}

/// Whether a folder holds CSV files and no bag.
#[must_use]
pub fn is_of_tables(folder: &Path) -> bool {
    let files = files(folder);
    let is_of_bag = |file: &PathBuf| {
        let name = file.file_name().and_then(std::ffi::OsStr::to_str);
        [name, ending(file)].into_iter().flatten().any(|word| OF_BAGS.contains(&word))
    };
    files.iter().any(|file| ending(file) == Some("csv"))
        && !files.iter().any(is_of_bag)
        && !folder.join("bag").exists()
}

/// Writes the sensors of a folder into one file; what is to be said of it.
///
/// # Errors
/// Where no file is that of a gyro or an accelerometer, or the sensors' files have no time in common.
pub fn together(folder: &Path, into: &Path) -> anyhow::Result<String> {
    let tables: Vec<PathBuf> = files(folder).into_iter().filter(|file| ending(file) == Some("csv")).collect();
    let time = common_time(&tables);
    let mut sensors: Vec<Sensor> = Vec::new();
    let mut without_gravity = Vec::new();
    for table in &tables {
        // What holds no numbers is a list of settings or words.
        let Ok(look) = whorl_bag::look(table, MOST_LINES) else { continue };
        if look.lines >= MOST_LINES {
            bail!(
                "{}: {MOST_LINES} lines or more; a folder of sensors takes fewer: cut the recording into parts",
                table.display()
            );
        }
        let Some(found) = time.as_ref().and_then(|time| sensor(&look, table, time)) else { continue };
        if found.channel == Channel::Accelerometer && !found.shows_gravity() {
            without_gravity.push(found.name);
            continue;
        }
        match sensors.iter_mut().find(|other| other.channel == found.channel) {
            None => sensors.push(found),
            // A phone corrects its sensors, and writes what it corrected beside what it read.
            Some(other) if other.is_uncorrected() && !found.is_uncorrected() => *other = found,
            Some(_) => {}
        }
    }
    let names: Vec<&str> = sensors.iter().map(|sensor| sensor.name.as_str()).collect();
    if !sensors.iter().any(|sensor| sensor.channel.info().is_motion) {
        let first = tables.first().map(|table| table.display().to_string()).unwrap_or_default();
        bail!(
            "{}: it is no bag, and no CSV file in it is called after a gyro or an accelerometer and has the columns x, y, z and a time, as \
             Gyroscope.csv of an app on a phone; a file for itself is given as: whorl new {first}",
            folder.display()
        );
    }
    if into.exists() {
        bail!("{} is there already; remove it, or choose another folder with --out", into.display());
    }
    write(into, &text(&sensors, &time.unwrap_or_default()))?;
    let mut said =
        format!("{} were put together in {}, each with lines of its own.", names.join(", "), into.display());
    if !without_gravity.is_empty() {
        let _ = write!(
            said,
            " {}: gravity was taken out there, so it is no accelerometer.",
            without_gravity.join(", ")
        );
    }
    Ok(said)
}

impl Sensor {
    fn is_uncorrected(&self) -> bool {
        self.name.to_lowercase().contains("uncalibrated")
    }

    fn shows_gravity(&self) -> bool {
        let [x, y, z] = &self.axes;
        let lengths = x.iter().zip(y).zip(z).map(|((x, y), z)| (x * x + y * y + z * z).sqrt());
        units::of_gravity(median(lengths.filter(|length| length.is_finite())), NEAR).is_some()
    }
}

/// Regular files, in the order of their names.
fn files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<PathBuf> =
        entries.take(MOST_FILES).flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.sort();
    files
}

fn ending(file: &Path) -> Option<&str> {
    file.extension().and_then(std::ffi::OsStr::to_str)
}

/// The time that all files of sensors have; since the start sooner than since 1970, which takes more digits.
fn common_time(tables: &[PathBuf]) -> Option<String> {
    let mut common: Option<Vec<String>> = None;
    for table in tables {
        let Ok(look) = whorl_bag::look(table, 100) else { continue };
        if by_file(&look, table).is_empty() {
            continue;
        }
        let is_time = |column: &&LookedColumn| {
            named(&column.name).meaning == Some(Meaning::Time) && column.present().next().is_some()
        };
        let names = look.columns.iter().filter(is_time).map(|column| column.name.clone());
        common = Some(match common {
            None => names.collect(),
            Some(common) => names.filter(|name| common.contains(name)).collect(),
        });
    }
    let common = common.unwrap_or_default();
    let elapsed = common.iter().find(|name| name.to_lowercase().contains("elapsed"));
    elapsed.or(common.first()).cloned()
}

fn sensor(look: &CsvLook, file: &Path, time: &str) -> Option<Sensor> {
    let called = by_file(look, file);
    let column = |wanted: &dyn Fn(&str) -> bool| look.columns.iter().find(|column| wanted(&column.name));
    let axis = |k: usize| {
        let of = |name: &str| called.get(name).is_some_and(|said| named(said).axis == Some(Axis::Body(k)));
        column(&of).map(|column| column.numbers.clone())
    };
    let Some(Meaning::Channel(channel)) = named(called.values().next()?).meaning else { return None };
    let stem = file.file_name()?.to_str()?.split('.').next()?.to_owned();
    let times = column(&|name: &str| name == time)?.numbers.clone();
    Some(Sensor { name: stem, channel, times, axes: [axis(0)?, axis(1)?, axis(2)?] })
}

/// The lines of all sensors by their time.
fn text(sensors: &[Sensor], time: &str) -> String {
    let mut header = vec![time.to_owned()];
    header.extend(
        sensors.iter().flat_map(|sensor| ["x", "y", "z"].map(|axis| format!("{}_{axis}", sensor.name))),
    );
    let mut lines: Vec<(f64, usize, usize)> = Vec::new();
    for (of, sensor) in sensors.iter().enumerate() {
        let times = sensor.times.iter().enumerate().filter(|(_, at)| at.is_finite());
        lines.extend(times.map(|(line, at)| (*at, of, line)));
    }
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut text = header.join(",") + "\n";
    for (at, of, line) in lines {
        let _ = write!(text, "{at}");
        for (k, sensor) in sensors.iter().enumerate() {
            let cell = |axis: &Vec<f64>| {
                axis.get(line).filter(|x| k == of && x.is_finite()).map(f64::to_string).unwrap_or_default()
            };
            sensor.axes.iter().for_each(|axis| {
                let _ = write!(text, ",{}", cell(axis));
            });
        }
        text.push('\n');
    }
    text
}
