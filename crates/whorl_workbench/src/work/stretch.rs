//! A stretch of a recording becomes a recording of its own: what was fitted to one must not test it.

use std::io::{BufReader, Read};
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use flate2::read::MultiGzDecoder;
use whorl_commands::runs::is_csv;
use whorl_params::{ParameterTree, Value};
use whorl_recording::{Recording, RunOrigin, Series, write_run};

use super::adopt::now;
use crate::api::{Choice, FileKind, Stretch};
use crate::bench::Workbench;
use crate::project::sources_in;

/// Largest text of a CSV file, decompressed: as its reader's.
const LARGEST: u64 = 1 << 30;
/// Lines that are looked at for what separates cells.
const LOOKED_AT: usize = 200;
/// Seconds in the units that maps know of times.
const UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];

/// Writes the stretch beside its recording, and uses it in place of the whole.
///
/// # Errors
/// When it is empty, or its times are not plain numbers; when it is there already.
pub fn stretch(bench: &Workbench, asked: &Stretch) -> Result<String> {
    let path = bench.listed(&asked.file, FileKind::Recording)?;
    if !(asked.to_s - asked.from_s > 0.0 && asked.from_s.is_finite() && asked.to_s.is_finite()) {
        bail!("a stretch is from one time to a later one");
    }
    let choice = bench.choice();
    let stem = asked.file.trim_end_matches(".gz").trim_end_matches(".csv").trim_end_matches(".mcap");
    let name = format!("{stem}_{:.2}_to_{:.2}_s", asked.from_s, asked.to_s).replace("-", "minus_");
    let name = if is_csv(&path) { format!("{name}.csv") } else { name };
    let out = bench.folder().join(&name);
    if out.exists() {
        bail!("{name} is there already");
    }
    if is_csv(&path) {
        let map = choice.channels.as_ref().context("choose a map first: it says which column is the time")?;
        cut_table(&path, &bench.listed(map, FileKind::Map)?, [asked.from_s, asked.to_s], &out)?;
    } else {
        let known = bench.known()?;
        let mut recording = sources_in(bench.folder(), &choice).recording(&path, &known)?;
        cut(&mut recording, [asked.from_s, asked.to_s]);
        if !recording.has_motion() {
            bail!("nothing was measured in this stretch");
        }
        let notes =
            vec![("stretch_of".to_owned(), format!("{}, {} to {} s", asked.file, asked.from_s, asked.to_s))];
        let version = env!("CARGO_PKG_VERSION").to_owned();
        write_run(
            &recording,
            &known,
            &RunOrigin { experiment: name.clone(), version, start_utc: now(), notes },
            &out,
        )?;
    }
    Ok(name)
}

/// The choice with a stretch in place of the whole that it is of.
pub fn with_stretch(mut choice: Choice, asked: &Stretch, name: &str) -> Choice {
    for list in [&mut choice.runs, &mut choice.held_out] {
        list.retain(|run| *run != asked.file);
    }
    if asked.held_out { &mut choice.held_out } else { &mut choice.runs }.push(name.to_owned());
    choice
}

/// Keeps the samples of a stretch, whose beginning becomes time zero.
fn cut(recording: &mut Recording, [from, to]: [f64; 2]) {
    fn keep<T: Clone>(series: &mut Series<T>, [from, to]: [f64; 2]) {
        let pairs = series.time_s.iter().zip(&series.value);
        *series =
            pairs.filter(|(t, _)| (from..=to).contains(*t)).map(|(t, v)| (t - from, v.clone())).collect();
    }
    let span = [from, to];
    keep(&mut recording.gyro_b_rad_s, span);
    keep(&mut recording.specific_force_b_m_s2, span);
    recording.vectors.iter_mut().for_each(|sensor| keep(&mut sensor.direction_b, span));
    keep(&mut recording.wheel_speed_rad_s, span);
    keep(&mut recording.wheel_torque_command_n_m, span);
    keep(&mut recording.wheel_current_a, span);
    keep(&mut recording.gimbal_angle_rad, span);
    keep(&mut recording.gimbal_rate_rad_s, span);
    keep(&mut recording.gimbal_torque_n_m, span);
    keep(&mut recording.body_torque_b_n_m, span);
    keep(&mut recording.bus_voltage_v, span);
    keep(&mut recording.tank_pressure_pa, span);
    keep(&mut recording.temperature_k, span);
    keep(&mut recording.ballast_moment_b_n_m, span);
    if let Some(truth) = &mut recording.truth {
        keep(&mut truth.q_world_body, span);
        keep(&mut truth.omega_wb_b_rad_s, span);
    }
    for pulses in &mut recording.jet_pulses {
        pulses.retain(|pulse| pulse.off_s > from && pulse.on_s < to);
        for pulse in pulses {
            (pulse.on_s, pulse.off_s) = (pulse.on_s.max(from) - from, pulse.off_s.min(to) - from);
        }
    }
}

/// The lines of a table between two times, cell by cell as they are.
fn cut_table(path: &Path, map: &Path, [from, to]: [f64; 2], out: &Path) -> Result<()> {
    let entries = ParameterTree::load_for(map, "csv")?;
    let text = |key: &str| match entries.get(key).map(|entry| &entry.value) {
        Some(Value::String(text)) => Some(text.clone()),
        _ => None,
    };
    let column = text("time.column").context("the map names no column of the time")?;
    let unit = text("time.unit").unwrap_or_else(|| "s".to_owned());
    let Some((_, scale)) = UNITS.iter().find(|(name, _)| *name == unit) else {
        bail!("times in {unit} cannot be cut: have the recording in s, ms, us or ns");
    };
    let look = whorl_bag::look(path, LOOKED_AT)?;
    let file = whorl_files::open_file(path)?;
    let packed = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("gz"));
    let source: Box<dyn Read> = if packed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(look.delimiter)
        .flexible(true)
        .from_reader(BufReader::new(source.take(LARGEST)));
    let header = reader.headers()?.clone();
    let Some(at) = header.iter().position(|name| name.trim() == column) else {
        bail!("there is no column {column:?} in the first line");
    };
    let mut writer =
        csv::WriterBuilder::new().delimiter(look.delimiter).flexible(true).from_writer(Vec::new());
    writer.write_record(&header)?;
    let (mut first, mut kept) = (None, 0_usize);
    for record in reader.records() {
        let record = record?;
        let Some(time) = record.get(at).and_then(|cell| cell.trim().replace(',', ".").parse::<f64>().ok())
        else {
            continue;
        };
        let since = (time - *first.get_or_insert(time)) * scale;
        if (from..=to).contains(&since) {
            writer.write_record(&record)?;
            kept += 1;
        }
    }
    if kept == 0 {
        bail!("no line of this stretch has a time that is a number");
    }
    let table = writer.into_inner().map_err(|error| anyhow::anyhow!("{}", error.error()))?;
    whorl_files::write_file(out, table).with_context(|| format!("cannot write {}", out.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_cut_at_the_times_that_its_map_says() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("map.yaml"), "csv:\n  time: {column: ms, unit: ms}\n").unwrap();
        std::fs::write(at("a.csv"), "gx;ms;\"a;b\"\n1;1000;x\n2;1500;\"y;z\"\n3;2000;x\n4;;x\n5;2500;x\n")
            .unwrap();
        cut_table(&at("a.csv"), &at("map.yaml"), [0.5, 1.0], &at("b.csv")).unwrap();
        let text = std::fs::read_to_string(at("b.csv")).unwrap();
        assert_eq!(text, "gx;ms;\"a;b\"\n2;1500;\"y;z\"\n3;2000;x\n");
        let error = cut_table(&at("a.csv"), &at("map.yaml"), [9.0, 10.0], &at("c.csv")).unwrap_err();
        assert!(error.to_string().contains("no line") && !at("c.csv").exists());
    }

    #[test]
    fn what_a_stretch_is_of_is_used_no_more() {
        let choice = Choice { runs: vec!["a.csv".to_owned()], ..Choice::default() };
        let asked = |held_out| Stretch { file: "a.csv".to_owned(), from_s: 0.0, to_s: 1.0, held_out };
        let choice = with_stretch(choice, &asked(true), "b.csv");
        let choice = with_stretch(choice, &asked(false), "c.csv");
        assert_eq!((choice.runs, choice.held_out), (vec!["c.csv".to_owned()], vec!["b.csv".to_owned()]));
    }
}
