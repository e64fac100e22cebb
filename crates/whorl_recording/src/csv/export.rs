//! A recording as a CSV file and the map that imports it again.

use std::fmt::Write as _;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use whorl_bag::{AXES, Channel, Form, NO_COLUMN};
use whorl_files::{NewFile, write_file};

use crate::series::{ChannelSeries, nanoseconds};
use crate::{Mounting, Recording, RecordingError};

/// What [`export_csv`] wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportedCsv {
    /// The measurements.
    pub csv: PathBuf,
    /// Which column is what: `whorl import csv` reads the file with it.
    pub map: PathBuf,
    /// Lines without the header.
    pub rows: usize,
}

/// Columns of one channel: values at times \[ns\], each with its cells.
struct Block {
    columns: usize,
    cells: Vec<(i64, String)>,
    next: usize,
}

/// Writes `<platform>.csv` and `<platform>.channels.yaml` into a directory (created if need be): one line for each
/// time at which anything was measured or commanded, in SI units; what has no value then stays empty. `wheels`
/// and `jets` name the columns; without names they are numbered.
///
/// # Errors
/// When a file cannot be written.
pub fn export_csv(
    recording: &Recording,
    wheels: &[String],
    jets: &[String],
    directory: &Path,
) -> Result<ExportedCsv, RecordingError> {
    std::fs::create_dir_all(directory).map_err(RecordingError::io("create", directory))?;
    let mut header = String::from("time_s");
    let mut map = format!(
        "# Which column of {}.csv is what; for `whorl import csv`. See docs/recordings.md.\n\
         csv:\n  ros__parameters:\n    time: {{column: time_s, unit: s, start: 0.0}}\n",
        recording.platform
    );
    let parts = Parts { wheels, jets };
    let mut blocks: Vec<Block> = Vec::new();
    for channel in Channel::ALL {
        for sensor in 0..channel.most_sensors() {
            let Some((names, cells)) = parts.columns(recording, *channel, sensor) else { continue };
            for name in names.iter().filter(|name| *name != NO_COLUMN) {
                let _ = write!(header, ",{name}");
            }
            let written = names.iter().filter(|name| *name != NO_COLUMN).count();
            let (key, rest) = in_map(recording, *channel, sensor);
            let columns = match names.as_slice() {
                [only] if channel.info().form == Form::Scalar => format!("column: {only}"),
                several => format!("columns: [{}]", several.join(", ")),
            };
            let _ = writeln!(map, "    {key}: {{{columns}{rest}}}");
            blocks.push(Block { columns: written, cells, next: 0 });
        }
    }
    let _ = writeln!(map, "    closed_loop: {}", recording.closed_loop);
    if recording.mounting == Mounting::Clamped {
        map.push_str("    mounting: clamped\n");
    }

    let mut times: Vec<i64> = blocks.iter().flat_map(|block| block.cells.iter().map(|(at, _)| *at)).collect();
    times.sort_unstable();
    times.dedup();
    let csv = directory.join(format!("{}.csv", recording.platform));
    let file = NewFile::create(&csv).map_err(RecordingError::io("create", &csv))?;
    let mut file = BufWriter::new(file);
    header.push('\n');
    file.write_all(header.as_bytes()).map_err(RecordingError::io("write", &csv))?;
    let mut line = String::new();
    for at in &times {
        line.clear();
        let _ = write!(line, "{}.{:09}", at.div_euclid(1_000_000_000), at.rem_euclid(1_000_000_000));
        for block in &mut blocks {
            line.push(',');
            match block.cells.get(block.next).filter(|(time, _)| time == at) {
                Some((_, cells)) => {
                    line.push_str(cells);
                    block.next += 1;
                }
                None => (1..block.columns).for_each(|_| line.push(',')),
            }
        }
        line.push('\n');
        file.write_all(line.as_bytes()).map_err(RecordingError::io("write", &csv))?;
    }
    let finished = file.into_inner().map_err(std::io::IntoInnerError::into_error).and_then(NewFile::finish);
    finished.map_err(RecordingError::io("write", &csv))?;
    let map_path = directory.join(format!("{}.channels.yaml", recording.platform));
    write_file(&map_path, map).map_err(RecordingError::io("write", &map_path))?;
    Ok(ExportedCsv { csv, map: map_path, rows: times.len() })
}

/// Key of a channel in the map, and what stands there besides its columns.
fn in_map(recording: &Recording, channel: Channel, sensor: usize) -> (String, String) {
    let key = channel.info().key.to_owned();
    let reference = recording.vectors.get(sensor).map(|vector| vector.reference_world);
    match (channel.info().form, reference) {
        (Form::Directions, Some(r)) => (
            format!("vectors.{key}_{}", sensor + 1),
            format!(", reference_world: [{:?}, {:?}, {:?}], repeats: true", r.x, r.y, r.z),
        ),
        (Form::Attitude, _) => (key, ", rotation: body_to_world".to_owned()),
        (Form::Pulses, _) => (key, format!(", quantity: on_time, unit: {}, slot: row", channel.unit())),
        _ => (key, format!(", unit: {}", channel.unit())),
    }
}

/// Names of the columns of a channel's `count` numbers: `gyro_x_rad_s`. `given` are the names of the platform's wheels or
/// jets; those without one are numbered.
#[must_use]
pub fn column_names(channel: Channel, sensor: usize, count: usize, given: &[String]) -> Vec<String> {
    let info = channel.info();
    let (stem, end) = info.column;
    let along = |names: &[&str], stem: &str| {
        names.iter().map(|axis| format!("{stem}_{axis}{end}")).collect::<Vec<_>>()
    };
    match info.form {
        Form::Axes => along(&AXES, stem),
        Form::Directions => along(&AXES, &format!("{stem}_{}", sensor + 1)),
        Form::Attitude => along(&["w", "x", "y", "z"], stem),
        Form::Scalar => vec![format!("{stem}{end}")],
        Form::Wheels { .. } | Form::Gimbals { .. } | Form::Pulses => {
            let name = |j: usize| given.get(j).cloned().unwrap_or_else(|| format!("{stem}_{}", j + 1));
            (0..count).map(|j| format!("{}{end}", name(j))).collect()
        }
    }
}

/// Names of the platform's wheels and jets, where they have some.
struct Parts<'a> {
    wheels: &'a [String],
    jets: &'a [String],
}

/// Names of a channel's columns, and their cells at times \[ns\].
type Columns = (Vec<String>, Vec<(i64, String)>);

impl Parts<'_> {
    /// Names of a channel's columns, and its cells at times \[ns\]; `None` where it was not recorded.
    fn columns(&self, recording: &Recording, channel: Channel, sensor: usize) -> Option<Columns> {
        let info = channel.info();
        let lacks = recording.lacks(channel);
        let cells = match recording.series(channel, sensor) {
            Some(series) => samples(series, lacks),
            None if info.form == Form::Pulses => pulses(recording),
            None => return None,
        };
        let count = cells.first()?.1.split(',').count();
        let given = match info.form {
            Form::Pulses => self.jets,
            Form::Wheels { .. } => self.wheels,
            _ => &[],
        };
        let mut names = column_names(channel, sensor, count, given);
        for (name, _) in names.iter_mut().zip(lacks).filter(|(_, lacks)| *lacks) {
            NO_COLUMN.clone_into(name);
        }
        Some((names, cells))
    }
}

/// Debug text of numbers: the shortest that reads back to the same bits. Axes that the sensor lacks are left out.
fn samples(series: &dyn ChannelSeries, lacks: [bool; 3]) -> Vec<(i64, String)> {
    let text = |numbers: Vec<f64>| {
        let there = numbers.iter().enumerate().filter(|(k, _)| lacks.get(*k) != Some(&true));
        there.map(|(_, x)| format!("{x:?}")).collect::<Vec<_>>().join(",")
    };
    let times = series.time_s().iter().enumerate();
    times.map(|(k, t)| (nanoseconds(*t), text(series.numbers(k)))).collect()
}

/// On-times at the times at which valves were switched on; zeros in the first line say that jets were recorded.
fn pulses(recording: &Recording) -> Vec<(i64, String)> {
    let jets = recording.jet_pulses.len();
    if jets == 0 {
        return Vec::new();
    }
    let first_s = recording.first_time_s().unwrap_or(0.0);
    let mut rows: std::collections::BTreeMap<i64, Vec<String>> = std::collections::BTreeMap::new();
    rows.insert(nanoseconds(first_s), vec!["0".to_owned(); jets]);
    for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
        for pulse in pulses {
            let row = rows.entry(nanoseconds(pulse.on_s)).or_insert_with(|| vec![String::new(); jets]);
            if let Some(cell) = row.get_mut(jet) {
                let length_ns = nanoseconds(pulse.off_s) - nanoseconds(pulse.on_s);
                *cell = format!("{}.{:09}", length_ns / 1_000_000_000, length_ns % 1_000_000_000);
            }
        }
    }
    rows.into_iter().map(|(at, cells)| (at, cells.join(","))).collect()
}
