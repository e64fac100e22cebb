//! A recording as a CSV file and the map that imports it again.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use crate::{Mounting, Recording, RecordingError, Series};

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
    let mut blocks: Vec<Block> = Vec::new();
    let mut add = |key: &str, names: &[String], rest: &str, cells: Vec<(i64, String)>| {
        if cells.is_empty() {
            return;
        }
        names.iter().for_each(|name| {
            let _ = write!(header, ",{name}");
        });
        let columns = match names {
            [only] => format!("column: {only}"),
            several => format!("columns: [{}]", several.join(", ")),
        };
        let _ = writeln!(map, "    {key}: {{{columns}{rest}}}");
        blocks.push(Block { columns: names.len(), cells, next: 0 });
    };
    let axes = |stem: &str, unit: &str| ["x", "y", "z"].map(|axis| format!("{stem}_{axis}{unit}")).to_vec();
    add("gyro", &axes("gyro", "_rad_s"), ", unit: rad/s", vectors(&recording.gyro_b_rad_s));
    let force = vectors(&recording.specific_force_b_m_s2);
    add("accelerometer", &axes("force", "_m_s2"), ", unit: m/s^2", force);
    for (index, channel) in recording.vectors.iter().enumerate() {
        let number = index + 1;
        let r = channel.reference_world;
        let rest = format!(", reference_world: [{:?}, {:?}, {:?}], repeats: true", r.x, r.y, r.z);
        let cells = vectors(&channel.direction_b);
        add(&format!("vectors.vector_{number}"), &axes(&format!("vector_{number}"), ""), &rest, cells);
    }
    let count = |series: &Series<Vec<f64>>| series.value.first().map_or(0, Vec::len);
    let named = |stem: &str, given: &[String], count: usize, unit: &str| -> Vec<String> {
        let name = |j: usize| given.get(j).cloned().unwrap_or_else(|| format!("{stem}_{}", j + 1));
        (0..count).map(|j| format!("{}{unit}", name(j))).collect()
    };
    let speed = &recording.wheel_speed_rad_s;
    add("wheel_speed", &named("wheel", wheels, count(speed), "_rad_s"), ", unit: rad/s", lists(speed));
    let torque = &recording.wheel_torque_command_n_m;
    let names = named("wheel", wheels, count(torque), "_n_m");
    add("wheel_torque_command", &names, ", unit: N m", lists(torque));
    let names = named("jet", jets, recording.jet_pulses.len(), "_on_s");
    add("jets", &names, ", quantity: on_time, unit: s, slot: row", pulses(recording));
    let torque = vectors(&recording.body_torque_b_n_m);
    add("body_torque", &axes("body_torque", "_n_m"), ", unit: N m", torque);
    let moment = vectors(&recording.ballast_moment_b_n_m);
    add("ballast_moment", &axes("ballast_moment", "_n_m"), ", unit: N m", moment);
    let one = |name: &str| vec![name.to_owned()];
    add("bus_voltage", &one("bus_v"), ", unit: V", scalars(&recording.bus_voltage_v));
    add("tank_pressure", &one("tank_pa"), ", unit: Pa", scalars(&recording.tank_pressure_pa));
    add("temperature", &one("temperature_k"), ", unit: K", scalars(&recording.temperature_k));
    if let Some(truth) = &recording.truth {
        let names = ["true_q_w", "true_q_x", "true_q_y", "true_q_z"].map(str::to_owned);
        let cells = of(&truth.q_world_body, |q| format!("{:?},{:?},{:?},{:?}", q.w, q.i, q.j, q.k));
        add("true_attitude", &names, ", rotation: body_to_world", cells);
        let rate = vectors(&truth.omega_wb_b_rad_s);
        add("true_rate", &axes("true_rate", "_rad_s"), ", unit: rad/s", rate);
    }
    let _ = writeln!(map, "    closed_loop: {}", recording.closed_loop);
    if recording.mounting == Mounting::Clamped {
        map.push_str("    mounting: clamped\n");
    }

    let mut times: Vec<i64> = blocks.iter().flat_map(|block| block.cells.iter().map(|(at, _)| *at)).collect();
    times.sort_unstable();
    times.dedup();
    let csv = directory.join(format!("{}.csv", recording.platform));
    let file = File::create(&csv).map_err(RecordingError::io("create", &csv))?;
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
    file.flush().map_err(RecordingError::io("write", &csv))?;
    let map_path = directory.join(format!("{}.channels.yaml", recording.platform));
    std::fs::write(&map_path, map).map_err(RecordingError::io("write", &map_path))?;
    Ok(ExportedCsv { csv, map: map_path, rows: times.len() })
}

/// Debug text of numbers: the shortest that reads back to the same bits.
fn of<T>(series: &Series<T>, cells: impl Fn(&T) -> String) -> Vec<(i64, String)> {
    series.time_s.iter().zip(&series.value).map(|(t, value)| (ns(*t), cells(value))).collect()
}

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

fn vectors(series: &Series<Vector3<f64>>) -> Vec<(i64, String)> {
    of(series, |v| format!("{:?},{:?},{:?}", v.x, v.y, v.z))
}

fn scalars(series: &Series<f64>) -> Vec<(i64, String)> {
    of(series, |x| format!("{x:?}"))
}

fn lists(series: &Series<Vec<f64>>) -> Vec<(i64, String)> {
    of(series, |list| list.iter().map(|x| format!("{x:?}")).collect::<Vec<_>>().join(","))
}

/// On-times at the times at which valves were switched on; zeros in the first line say that jets were recorded.
fn pulses(recording: &Recording) -> Vec<(i64, String)> {
    let jets = recording.jet_pulses.len();
    if jets == 0 {
        return Vec::new();
    }
    let first_s = recording.first_time_s().unwrap_or(0.0);
    let mut rows: std::collections::BTreeMap<i64, Vec<String>> = std::collections::BTreeMap::new();
    rows.insert(ns(first_s), vec!["0".to_owned(); jets]);
    for (jet, pulses) in recording.jet_pulses.iter().enumerate() {
        for pulse in pulses {
            let row = rows.entry(ns(pulse.on_s)).or_insert_with(|| vec![String::new(); jets]);
            if let Some(cell) = row.get_mut(jet) {
                let length_ns = ns(pulse.off_s) - ns(pulse.on_s);
                *cell = format!("{}.{:09}", length_ns / 1_000_000_000, length_ns % 1_000_000_000);
            }
        }
    }
    rows.into_iter().map(|(at, cells)| (at, cells.join(","))).collect()
}
