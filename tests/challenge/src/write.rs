//! Cases as files: CSV with its map, the platform's parameter file with the stated noise, and the answer
//! in a file of its own.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use nalgebra::Vector3;
use whorl_recording::{Mounting, Recording, Series};

use crate::cases::Built;

/// Writes a case into a folder of its own below `folder`: `MAP.yaml` (`MAP_clamped.yaml`), `whorl_1.yaml`,
/// `train_*.csv`, `held_out.csv`, `follow_up*.csv`, `answer.json`.
///
/// # Errors
/// When a file cannot be written.
pub fn case(folder: &Path, built: &Built) -> Result<()> {
    let folder = folder.join(built.spec.key().replace('/', "_"));
    std::fs::create_dir_all(&folder).with_context(|| format!("{}", folder.display()))?;
    let put = |name: &str, text: String| {
        std::fs::write(folder.join(name), text).with_context(|| format!("{}", folder.join(name).display()))
    };
    let follow_ups = built.follow_ups.iter().map(|follow_up| &follow_up.recording);
    let all = || built.training.iter().chain(&built.held_out).chain(follow_ups.clone());
    // One map for all: a run in which the masses stayed at rest says so.
    let has_ballast = all().any(|recording| !recording.ballast_moment_b_n_m.is_empty());
    let alike = |recording: &Recording| {
        let mut recording = recording.clone();
        if has_ballast && recording.ballast_moment_b_n_m.is_empty() {
            recording.ballast_moment_b_n_m = Series { time_s: vec![0.0], value: vec![Vector3::zeros()] };
        }
        recording
    };
    for (i, recording) in built.training.iter().enumerate() {
        put(&format!("train_{}.csv", i + 1), csv(&alike(recording)))?;
    }
    for recording in &built.held_out {
        put("held_out.csv", csv(&alike(recording)))?;
    }
    for recording in follow_ups.clone() {
        put(&format!("{}.csv", recording.name), csv(&alike(recording)))?;
    }
    if let Some(first) = built.training.first() {
        put("MAP.yaml", map(&alike(first)))?;
    }
    put("whorl_1.yaml", platform(built)?)?;
    put("answer.json", serde_json::to_string_pretty(&built.answer)?)
}

/// Wheels and jets by number: the order is that of the parameter file.
fn columns(recording: &Recording) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    if !recording.gyro_b_rad_s.is_empty() {
        names.extend(["gx", "gy", "gz", "ax", "ay", "az"].map(str::to_owned));
    }
    let wheels = recording.wheel_speed_rad_s.value.first().map_or(0, Vec::len);
    names.extend((1..=wheels).map(|w| format!("speed_{w}")));
    names.extend((1..=wheels).map(|w| format!("command_{w}")));
    names.extend((1..=recording.jet_pulses.len()).map(|j| format!("jet_{j}")));
    if !recording.vectors.is_empty() {
        names.extend(["vx", "vy", "vz"].map(str::to_owned));
    }
    if !recording.ballast_moment_b_n_m.is_empty() {
        names.extend(["bx", "by", "bz"].map(str::to_owned));
    }
    for (name, series) in [
        ("volt", &recording.bus_voltage_v),
        ("pressure", &recording.tank_pressure_pa),
        ("temperature", &recording.temperature_k),
    ] {
        if !series.is_empty() {
            names.push(name.to_owned());
        }
    }
    names
}

/// One line per instant at which anything was measured or commanded; the rest is blank.
fn csv(recording: &Recording) -> String {
    let names = columns(recording);
    let place: BTreeMap<&str, usize> = names.iter().enumerate().map(|(i, n)| (n.as_str(), i)).collect();
    let mut rows: BTreeMap<i64, Vec<Option<f64>>> = BTreeMap::new();
    let mut put = |time_s: f64, name: &str, value: f64| {
        let row = rows.entry((time_s * 1e9).round() as i64).or_insert_with(|| vec![None; names.len()]);
        if let Some(cell) = place.get(name).and_then(|i| row.get_mut(*i)) {
            *cell = Some(value);
        }
    };
    let three = [("gx", "ax", "vx", "bx"), ("gy", "ay", "vy", "by"), ("gz", "az", "vz", "bz")];
    for (i, (gyro, accel, vector, ballast)) in three.into_iter().enumerate() {
        let series = [
            (gyro, Some(&recording.gyro_b_rad_s)),
            (accel, Some(&recording.specific_force_b_m_s2)),
            (vector, recording.vectors.first().map(|v| &v.direction_b)),
            (ballast, Some(&recording.ballast_moment_b_n_m)),
        ];
        for (name, series) in series {
            let Some(series) = series else { continue };
            for (time_s, value) in series.time_s.iter().zip(&series.value) {
                put(*time_s, name, value[i]);
            }
        }
    }
    for (prefix, series) in
        [("speed", &recording.wheel_speed_rad_s), ("command", &recording.wheel_torque_command_n_m)]
    {
        for (time_s, values) in series.time_s.iter().zip(&series.value) {
            for (w, value) in values.iter().enumerate() {
                put(*time_s, &format!("{prefix}_{}", w + 1), *value);
            }
        }
    }
    for (j, pulses) in recording.jet_pulses.iter().enumerate() {
        let name = format!("jet_{}", j + 1);
        put(0.0, &name, 0.0);
        for pulse in pulses {
            put(pulse.on_s, &name, 1.0);
            put(pulse.off_s, &name, 0.0);
        }
    }
    for (name, series) in [
        ("volt", &recording.bus_voltage_v),
        ("pressure", &recording.tank_pressure_pa),
        ("temperature", &recording.temperature_k),
    ] {
        for (time_s, value) in series.time_s.iter().zip(&series.value) {
            put(*time_s, name, *value);
        }
    }
    let mut text = format!("t,{}\n", names.join(","));
    for (time_ns, row) in &rows {
        // Writing to a String cannot fail.
        let _ = write!(text, "{:.9}", *time_ns as f64 * 1e-9);
        for cell in row {
            match cell {
                Some(value) => {
                    let _ = write!(text, ",{value:.9}");
                }
                None => text.push(','),
            }
        }
        text.push('\n');
    }
    text
}

fn map(recording: &Recording) -> String {
    let names = columns(recording);
    let has = |name: &str| names.iter().any(|n| n == name);
    let numbered = |prefix: &str| {
        let of: Vec<&str> = names.iter().filter(|n| n.starts_with(prefix)).map(String::as_str).collect();
        of.join(", ")
    };
    let mut text = String::from("csv:\n  ros__parameters:\n    time: {column: t, unit: s}\n");
    let mut line = |wanted: &str, body: String| {
        if has(wanted) {
            let _ = writeln!(text, "    {body}");
        }
    };
    line("gx", "gyro: {columns: [gx, gy, gz], unit: rad/s}".into());
    line("ax", "accelerometer: {columns: [ax, ay, az], unit: m/s^2}".into());
    line("speed_1", format!("wheel_speed: {{columns: [{}], unit: rad/s}}", numbered("speed_")));
    line("command_1", format!("wheel_torque_command: {{columns: [{}], unit: N m}}", numbered("command_")));
    line("jet_1", format!("jets: {{columns: [{}], quantity: open}}", numbered("jet_")));
    if let Some(vector) = recording.vectors.first() {
        let r = vector.reference_world;
        line(
            "vx",
            format!(
                "vector: {{columns: [vx, vy, vz], reference_world: [{:.6}, {:.6}, {:.6}]}}",
                r.x, r.y, r.z
            ),
        );
    }
    line("bx", "ballast_moment: {columns: [bx, by, bz], unit: N m}".into());
    line("volt", "bus_voltage: {column: volt, unit: V}".into());
    line("pressure", "tank_pressure: {column: pressure, unit: Pa}".into());
    line("temperature", "temperature: {column: temperature, unit: K}".into());
    if recording.closed_loop {
        text.push_str("    closed_loop: true\n");
    }
    if recording.mounting == Mounting::Clamped {
        text.push_str("    mounting: clamped\n");
    }
    text
}

/// Whorl-I's parameter file with the stated noise.
fn platform(built: &Built) -> Result<String> {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../params/whorl_1.yaml");
    let mut text = std::fs::read_to_string(file).context("params/whorl_1.yaml")?;
    let s = &built.model.sensors;
    let vector = s.vector.map_or(0.0, |v| v.noise_stddev_rad);
    for (group, key, value) in [
        ("gyro:", "noise_stddev_rad_s:", s.gyro.errors.noise_stddev.x),
        ("accelerometer:", "noise_stddev_m_s2:", s.accelerometer.errors.noise_stddev.x),
        ("vector:", "noise_stddev_rad:", vector),
        ("wheel_speed:", "noise_stddev_rad_s:", s.wheel_speed.noise_stddev_rad_s),
    ] {
        let start = text.find(&format!(" {group}\n")).with_context(|| format!("no {group}"))?;
        let at = start
            + text.get(start..).and_then(|t| t.find(key)).with_context(|| format!("no {key}"))?
            + key.len();
        let end = at + text.get(at..).and_then(|t| t.find(['#', '\n'])).unwrap_or(0);
        text.replace_range(at..end, &format!(" {value:.6e}  "));
    }
    Ok(text)
}
