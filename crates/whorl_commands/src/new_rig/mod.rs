//! From a file to a first comparison: the platform's file and the map of channels of a recording that comes with neither.
//!
//! Names of columns and types of topics say what is what; units follow from names, and where these are silent from gravity, from
//! turns that gyro and direction sensors both see, and from what is plausible. A first reading with this draft shows rest, noise, rates and
//! axes. Every line says where its number is from; what no file can say is asked of somebody, or marked.

mod axes;
mod bare;
mod channels;
mod folder;
#[cfg(test)]
mod folder_tests;
#[cfg(test)]
mod foreign_tests;
mod group;
mod hinge;
pub mod lines;
mod measure;
#[cfg(test)]
mod motion_tests;
mod names;
pub mod next;
mod otherwise;
mod preset;
pub mod questions;
mod rig;
mod table;
#[cfg(test)]
mod tests;
mod time;
mod topics;
mod units;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use whorl_bag::{Channel, CsvMap, Form, NO_COLUMN, RunDirectory};
use whorl_math::words::shortened;
use whorl_recording::{
    KnownPlatform, ReadOptions, Recording, platform_parts, read_csv_beginning, read_model, read_run_with,
};

use crate::runs::write;
use channels::MapDraft;
use hinge::HINGE_ANGLE;
use lines::{Lines, Origin, Sourced};
use measure::{Measured, measure};
use next::Next;
use questions::Ask;
use rig::Parts;

pub use preset::Preset;

/// Lines of a CSV file that are looked at: an hour at 100 Hz.
const LOOKED_AT: usize = 330_000;
/// How often the draft is corrected and read again.
const CORRECTIONS: usize = 3;
/// A vector sensor that sees within 6 deg of the vertical adds nothing to an accelerometer \[1\].
const VERTICAL: f64 = 0.995;

/// Column names in a message: their characters.
const LONGEST_LIST: usize = 2_000;
const LONGEST_NAME: usize = 60;

/// Up in body axes of a rig that lies on its face, its third component \[1\].
const UPSIDE_DOWN: f64 = -0.9;

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct NewRig {
    /// Name of the platform.
    pub platform: String,
    /// The recording: what was given, or what the files of a folder were put together in.
    pub file: PathBuf,
    /// Its file.
    pub rig: PathBuf,
    /// The map of channels.
    pub map: PathBuf,
    /// Every line of both files.
    pub lines: Vec<lines::Line>,
    /// Samples in the recording, by channel.
    pub samples: Vec<(&'static str, usize)>,
    /// Columns or topics that are not used.
    pub ignored: Vec<String>,
    /// What is to be said of the file.
    pub notes: Vec<String>,
    /// Why the commands that explain data would refuse it, if they would.
    pub refused: Vec<String>,
    /// What to do with it next.
    pub next: Next,
}

impl NewRig {
    /// Lines that nobody vouches for.
    #[must_use]
    pub fn assumed(&self) -> usize {
        Lines(self.lines.clone()).assumed()
    }
}

/// Writes the platform's file and the map of a CSV file, a bag or a folder with a CSV file for each sensor into a folder. `preset` is the
/// kind of rig; `None`: what the file looks like.
///
/// # Errors
/// When the file cannot be read, measures nothing that moves, or the files are there already; nothing is left behind then.
pub fn new_rig(file: &Path, out: &Path, preset: Option<Preset>, ask: &mut dyn Ask) -> anyhow::Result<NewRig> {
    if !folder::is_of_tables(file) {
        return of_file(file, out, preset, ask);
    }
    std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let whole = out.join(format!("{}.csv", plain_name(file)));
    let said = folder::together(file, &whole)?;
    let made = of_file(&whole, out, preset, ask);
    match made {
        Ok(mut made) => {
            made.notes.insert(0, said);
            Ok(made)
        }
        Err(error) => {
            // As of the other drafts.
            let _ = std::fs::remove_file(&whole);
            Err(error)
        }
    }
}

fn of_file(file: &Path, out: &Path, preset: Option<Preset>, ask: &mut dyn Ask) -> anyhow::Result<NewRig> {
    let (mut draft, wheels) = draft(file, preset, ask)?;
    let platform = questions::name(ask, "Name of the rig", plain_name(file));
    let (rig, map) = (out.join(format!("{platform}.yaml")), out.join(format!("{platform}.channels.yaml")));
    for there in [&rig, &map] {
        if there.exists() {
            bail!("{} is there already; remove it, or choose another folder with --out", there.display());
        }
    }
    std::fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    let written = complete(
        file,
        &mut draft,
        Parts { wheels, preset, ..Parts::default() },
        &platform,
        (&rig, &map),
        ask,
    );
    if written.is_err() {
        // Drafts are of no use to anybody; an error to remove them would hide why.
        let _ = (std::fs::remove_file(&rig), std::fs::remove_file(&map));
    }
    written
}

fn draft(file: &Path, preset: Option<Preset>, ask: &mut dyn Ask) -> anyhow::Result<(MapDraft, Vec<String>)> {
    if !file.exists() {
        bail!("{}: there is no such file", file.display());
    }
    if whorl_bag::is_bag(file) {
        let run = RunDirectory::open(file)?;
        if !run.parameter_files().is_empty() {
            bail!(
                "{} is a run of Whorl with its parameters: whorl compare {} takes it as it is",
                file.display(),
                file.display()
            );
        }
        return topics::draft(&run.bag()?).with_context(|| file.display().to_string());
    }
    let look = whorl_bag::look(file, LOOKED_AT)?;
    let mut called = bare::by_file(&look, file);
    let drafted = |called: &table::Called| {
        table::draft(&look, called, preset).with_context(|| file.display().to_string())
    };
    let mut draft = drafted(&called)?;
    questions::columns(ask, &look, &draft.ignored, &mut called);
    if !called.is_empty() {
        draft = drafted(&called)?;
    }
    if !draft.entries.iter().any(|entry| entry.channel.info().is_motion) {
        let names: Vec<&str> = look.columns.iter().map(|column| column.name.as_str()).collect();
        let is_motion = |column: &&whorl_bag::LookedColumn| matches!(names::named(&column.name).meaning, Some(names::Meaning::Channel(c)) if c.info().is_motion);
        let known: Vec<&str> =
            look.columns.iter().filter(is_motion).map(|column| column.name.as_str()).collect();
        let why = if known.is_empty() {
            let there = names.join(", ");
            format!(
                "no column is known as a gyro's, an accelerometer's, a wheel's speed or a hinge's angle; there are: {}. Names that are \
                 known are gx, gyro_x, ax, acc_x, wheel_speed_1, yaw_deg and many like these; docs/recordings.md shows how to write a \
                 map by hand{}",
                shortened(&there, LONGEST_LIST),
                draft
                    .notes
                    .iter()
                    .map(|note| format!(". {}", note.trim_end_matches('.')))
                    .collect::<String>()
            )
        } else {
            let known = known.join(", ");
            format!(
                "{} never change, or hold no numbers: nothing was measured",
                shortened(&known, LONGEST_LIST)
            )
        };
        bail!("{}: {why}", file.display());
    }
    let wheels = draft.entries.iter().find(|entry| matches!(entry.channel.info().form, Form::Wheels { .. }));
    let count = wheels.map_or(0, |entry| entry.columns.len());
    Ok((draft, (1..=count).map(|j| format!("wheel_{j}")).collect()))
}

/// Writes drafts, reads the file by them, and writes what it shows.
fn complete(
    file: &Path,
    draft: &mut MapDraft,
    mut parts: Parts,
    platform: &str,
    (rig, map): (&Path, &Path),
    ask: &mut dyn Ask,
) -> anyhow::Result<NewRig> {
    parts_of(draft, &mut parts);
    let first = rig::lines(platform, &parts, &Measured::not_yet(), &mut questions::Nobody).text(&[]);
    let reading = |draft: &MapDraft| -> anyhow::Result<(Recording, KnownPlatform)> {
        write(map, &draft.lines(platform).text(&[]))?;
        write(rig, &first)?;
        let known = read_model(rig, None)?;
        Ok((recording_of(file, map, &known)?, known))
    };
    let (mut recording, mut known) = reading(draft)?;
    // Signs may show only with the right unit, and the unit only with the right signs.
    for _ in 0..CORRECTIONS {
        if !axes::correct(draft, &recording, &known.model) {
            break;
        }
        (recording, known) = reading(draft)?;
    }
    let seen = measure(&recording, &known.model);
    place_vectors(draft, &seen);
    parts_of(draft, &mut parts);
    // A bag's messages always have three numbers; which of them are measured, their numbers say.
    for (axes, channel) in
        [(&mut parts.gyro_axes, Channel::Gyro), (&mut parts.force_axes, Channel::Accelerometer)]
    {
        *axes = [0, 1, 2].map(|k| axes[k] && !recording.lacks(channel)[k]);
    }
    let rig_lines = rig::lines(platform, &parts, &seen, ask);
    let map_lines = draft.lines(platform);
    let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let legend =
        "Each line says where its number is from; `assumed` marks what the file cannot say.".to_owned();
    write(rig, &rig_lines.text(&[format!("Rig of {name}, written by `whorl new`."), legend.clone()]))?;
    write(map, &map_lines.text(&[format!("What is what in {name}, written by `whorl new`."), legend]))?;
    let known = read_model(rig, None)?;
    let recording = recording_of(file, map, &known)?;
    let mut notes = std::mem::take(&mut draft.notes);
    let refused = recording.contradictions(Some(&known.model));
    notes.extend(recording.remarks.iter().filter(|remark| !refused.contains(remark)).cloned());
    notes.extend(recording.gaps());
    if seen.up_b.is_some_and(|up_b| up_b.z < UPSIDE_DOWN) {
        notes.push(
            "The accelerometer reads -1 g on z at rest: z points down (as in px4: forward, right, down), the rig lies on its face, or all \
             three signs are reversed. A sensor whose z points up reads +1 g there (specific force): -y and -z in the map turn axes that \
             point right and down, of all sensors; -ax, -ay, -az reverse signs."
                .to_owned(),
        );
    }
    if seen.rest_s > 0.0 {
        notes.push(format!("The rig rests for {} s in all.", lines::number(seen.rest_s)));
    }
    let samples = recording.sampled().map(|(channel, _, series)| (channel.info().key, series.time_s().len()));
    Ok(NewRig {
        platform: platform.to_owned(),
        file: file.to_owned(),
        rig: rig.to_owned(),
        map: map.to_owned(),
        samples: samples.collect(),
        ignored: draft.ignored.iter().map(|name| shortened(name, LONGEST_NAME).into_owned()).collect(),
        refused,
        next: next::next(&recording, &known, (!draft.is_bag).then_some(map), &rig_lines),
        notes,
        lines: map_lines.0.into_iter().chain(rig_lines.0).collect(),
    })
}

fn recording_of(file: &Path, map: &Path, known: &KnownPlatform) -> anyhow::Result<Recording> {
    if whorl_bag::is_bag(file) {
        let options =
            ReadOptions { platform: Some(&known.platform), model: Some(&known.model), channels: Some(map) };
        return read_run_with(file, &options)?.into_iter().next().context("nothing was measured");
    }
    let map = CsvMap::load_for(map, &platform_parts(known))?;
    Ok(read_csv_beginning(file, &map, known, LOOKED_AT as u64)?.recording)
}

/// What of the platform's file depends on the map.
fn parts_of(draft: &MapDraft, parts: &mut Parts) {
    let there = |entry: &channels::Entry| {
        [0, 1, 2].map(|k| entry.columns.get(k).is_some_and(|name| name != NO_COLUMN))
    };
    let gyro = draft.entry(Channel::Gyro);
    parts.gyro_axes = match gyro {
        None => [false; 3],
        Some(_) if draft.is_bag => [true; 3],
        Some(entry) if entry.key == HINGE_ANGLE => hinge::axes(entry),
        Some(entry) => there(entry),
    };
    parts.is_angle = gyro.is_some_and(|entry| entry.key == HINGE_ANGLE);
    let both = draft.is_bag && gyro.is_some_and(|entry| entry.key == "imu");
    parts.force_axes = match draft.entry(Channel::Accelerometer) {
        None => [both; 3],
        Some(_) if draft.is_bag => [true; 3],
        Some(entry) => there(entry),
    };
    parts.vectors = draft.entries.iter().filter(|entry| entry.channel == Channel::Vector).count();
    parts.tachometer = draft.entry(Channel::WheelSpeed).is_some();
    parts.bus = draft.entry(Channel::BusVoltage).is_some();
    let torque = draft.entry(Channel::WheelTorqueCommand).and_then(|entry| entry.unit.as_ref());
    parts.torque_unit_is_assumed = torque.is_some_and(|unit| unit.origin == Origin::Assumed);
    let of_wheels =
        draft.entries.iter().find(|entry| matches!(entry.channel.info().form, Form::Wheels { .. }));
    parts.wheels_are_axes = of_wheels.is_some_and(|entry| {
        let axes = entry.columns.iter().map(|name| names::named(name).axis);
        entry.columns.len() == 3 && axes.eq((0..3).map(|k| Some(names::Axis::Body(k))))
    });
}

/// Says in the map what each of several vector sensors sees in the world, and leaves out those that see the vertical, as the
/// accelerometer does.
fn place_vectors(draft: &mut MapDraft, seen: &Measured) {
    let sensors = draft.entries.iter().filter(|entry| entry.channel == Channel::Vector).count();
    let mut worlds = seen.vectors.iter().map(|sensor| sensor.world);
    let mut left_out = Vec::new();
    draft.entries.retain_mut(|entry| {
        if entry.channel != Channel::Vector {
            return true;
        }
        let Some(world) = worlds.next().flatten() else { return true };
        let is_vertical = world.z.abs() > VERTICAL;
        if is_vertical {
            left_out.push(entry.columns.join(", "));
        } else if sensors > 1 {
            entry.more.push(format!("reference_world: {}", lines::list(world.as_slice())));
            entry.of = Sourced::new((), Origin::Measured, "north is where the first vector sensor points");
        }
        !is_vertical
    });
    for columns in left_out {
        draft
            .notes
            .push(format!("{columns} see the vertical, as the accelerometer does, and are not in the map."));
    }
}

/// A name for the rig: the file's, of letters, digits and underscores.
fn plain_name(file: &Path) -> String {
    let stem = file.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let stem = stem.split('.').next().unwrap_or_default();
    let plain: String = stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let plain = plain.trim_matches('_');
    match plain.chars().next() {
        Some(first) if first.is_ascii_alphabetic() => plain.to_owned(),
        _ => format!("rig_{plain}").trim_end_matches('_').to_owned(),
    }
}
