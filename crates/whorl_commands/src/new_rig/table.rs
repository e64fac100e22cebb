//! A map of the columns of a CSV file: by their names, and where these say nothing by their numbers.

use std::collections::BTreeMap;

use whorl_bag::{Channel, CsvLook, Form, LookedColumn, NO_COLUMN};

use super::channels::{Entry, MapDraft};
use super::group::{Group, Groups, cell, steady_length, usual_length};
use super::hinge::take_angle;
use super::lines::{Origin, Sourced};
use super::names::{Axis, Meaning, Named, named};
use super::otherwise::{by_numbers, seen_otherwise};
use super::time::time;
use super::{Preset, units};

/// What somebody said that columns are, as names that are known, by the names that they have.
pub type Called = BTreeMap<String, String>;

/// The draft of a file's map.
///
/// # Errors
/// A file without names of columns.
pub fn draft(look: &CsvLook, called: &Called, preset: Option<Preset>) -> anyhow::Result<MapDraft> {
    if look.lacks_names {
        let names: Vec<String> = (1..=look.columns.len()).map(|k| format!("c{k}")).collect();
        anyhow::bail!(
            "the first line has numbers where names of columns should be; write a line with a name for each of the {} columns above \
             it, as t, gx, gy, gz, or: {}",
            look.columns.len(),
            names.join(",")
        );
    }
    let name_of = |column: &LookedColumn| match called.get(&column.name) {
        Some(answer) => Named { column: column.name.clone(), ..named(answer) },
        None => named(&column.name),
    };
    let names: Vec<Named> = look.columns.iter().map(name_of).collect();
    let mut groups: Groups<'_> = BTreeMap::new();
    for (name, column) in names.iter().zip(&look.columns) {
        if column.present().next().is_some() || column.dates > 0 {
            groups.entry((name.stem.clone(), name.meaning)).or_default().push((name, column));
        }
    }
    let mut draft = MapDraft { form: form(look), ..MapDraft::default() };
    let in_order: Group<'_> = names.iter().zip(&look.columns).collect();
    draft.time = Some(time(&in_order, look.lines));
    let (mut vectors, mut wheels): (Vec<(String, Entry)>, Vec<Entry>) = Default::default();
    for ((stem, meaning), group) in &groups {
        let Some(meaning) = meaning.or_else(|| by_numbers(group)) else { continue };
        let Some(channel) = seen_otherwise(meaning, group, &groups, preset) else { continue };
        let Some(entry) = entry(channel, group) else { continue };
        match channel.info().form {
            Form::Directions => vectors.push((stem.clone(), entry)),
            Form::Wheels { .. } => wheels.push(entry),
            _ if draft.entry(channel).is_some() => draft.notes.push(format!(
                "{} is in two groups of columns; {} are used, {} are not.",
                channel.info().key,
                draft.entry(channel).map(|there| there.columns.join(", ")).unwrap_or_default(),
                entry.columns.join(", ")
            )),
            _ => draft.entries.push(entry),
        }
    }
    take_wheels(&mut draft, wheels);
    if draft.entry(Channel::Gyro).is_none() && preset != Some(Preset::WheelBench) {
        take_angle(&mut draft, &in_order);
    }
    take_vectors(&mut draft, vectors);
    draft.entries.sort_by_key(|entry| entry.channel);
    draft.ignored = ignored(look, &draft);
    if groups.keys().any(|(_, meaning)| *meaning == Some(Meaning::Channel(Channel::Jets))) {
        draft.notes.push(
            "Columns of jets are not in the map: where each jet is and how hard it pushes is in no file; write the jets into the \
             platform's file first (params/README.md), then the columns into the map (docs/recordings.md)."
                .to_owned(),
        );
    }
    Ok(draft)
}

/// What is not as usual between the cells.
fn form(look: &CsvLook) -> Vec<Sourced<String>> {
    let mut form = Vec::new();
    if look.delimiter != b',' {
        let shown =
            if look.delimiter == b'\t' { "\\t".to_owned() } else { char::from(look.delimiter).to_string() };
        form.push(Sourced::new(
            format!("delimiter: \"{shown}\""),
            Origin::Measured,
            "so the cells are separated",
        ));
    }
    if look.decimal_comma {
        form.push(Sourced::new("decimal: \",\"".to_owned(), Origin::Measured, "so the numbers are written"));
    }
    form
}

/// The entry of a channel, where there are the columns that it needs.
fn entry(channel: Channel, group: &Group<'_>) -> Option<Entry> {
    let info = channel.info();
    let axes = |wanted: &[Axis]| -> Vec<Option<(&Named, &LookedColumn)>> {
        wanted.iter().map(|axis| cell(group, *axis)).collect()
    };
    let body = [Axis::Body(0), Axis::Body(1), Axis::Body(2)];
    let mut of = Sourced::new((), Origin::Stated, "");
    let found: Vec<Option<(&Named, &LookedColumn)>> = match info.form {
        Form::Axes | Form::Directions => {
            let found = axes(&body);
            let there = found.iter().flatten().count();
            if there == 0 && matches!(channel, Channel::Gyro | Channel::BodyTorque) {
                // One column without an axis.
                let [only] = group[..] else { return None };
                of = Sourced::new((), Origin::Assumed, "about z; check it");
                vec![None, None, Some(only)]
            } else if there == 3 || there > 0 && info.may_lack_axes {
                found
            } else {
                return None;
            }
        }
        Form::Attitude => axes(&[Axis::W, body[0], body[1], body[2]]),
        Form::Scalar => vec![group.first().copied()],
        Form::Wheels { .. } => {
            let mut members: Group<'_> = group.clone();
            members.sort_by_key(|(name, _)| name.axis);
            members.into_iter().map(Some).collect()
        }
        Form::Gimbals { .. } | Form::Pulses => return None,
    };
    if info.form == Form::Attitude && found.iter().any(Option::is_none) {
        return None;
    }
    // An axis that reads the same number throughout is not measured.
    let is_dead = |column: &LookedColumn| {
        let first = column.present().next();
        info.may_lack_axes && column.present().count() > 10 && column.present().all(|x| Some(x) == first)
    };
    let mut dead = Vec::new();
    let columns: Vec<String> = found
        .iter()
        .map(|cell| match cell {
            Some((name, column)) if is_dead(column) => {
                dead.push(name.column.clone());
                NO_COLUMN.to_owned()
            }
            Some((name, _)) => name.column.clone(),
            None => NO_COLUMN.to_owned(),
        })
        .collect();
    if columns.iter().all(|name| name == NO_COLUMN) {
        return None;
    }
    if !dead.is_empty() {
        of = Sourced::new(
            (),
            Origin::Measured,
            format!("{} never changes and is left out", dead.join(" and ")),
        );
    }
    let members: Vec<(&Named, &LookedColumn)> = found.into_iter().flatten().collect();
    Some(Entry {
        key: info.key.to_owned(),
        channel,
        columns,
        of,
        unit: units::of(channel, &members, steady_length(group), usual_length(&members)),
        more: Vec::new(),
    })
}

/// Wheels' channels must have one column for each wheel: those with another number than the first are left out. Of two that could be
/// the commands, those that are called so are.
fn take_wheels(draft: &mut MapDraft, mut wheels: Vec<Entry>) {
    let is_commanded = |entry: &Entry| entry.columns.iter().all(|column| super::names::is_commanded(column));
    wheels.sort_by_key(|entry| (entry.channel, !is_commanded(entry)));
    for entry in wheels {
        let columns = entry.columns.join(", ");
        let of_wheels = |there: &&Entry| matches!(there.channel.info().form, Form::Wheels { .. });
        let other =
            draft.entries.iter().filter(of_wheels).find(|there| there.columns.len() != entry.columns.len());
        let note = match (draft.entry(entry.channel), other) {
            (Some(there), _) => {
                format!("{columns} are not in the map: {} are the {}.", there.columns.join(", "), there.key)
            }
            (None, Some(other)) => format!(
                "{columns} are not in the map: {} for {} is taken for one column to each wheel, and these are {}.",
                other.columns.join(", "),
                other.key,
                entry.columns.len()
            ),
            (None, None) => {
                draft.entries.push(entry);
                continue;
            }
        };
        draft.notes.push(note);
    }
}

/// One vector sensor, or several by their names.
fn take_vectors(draft: &mut MapDraft, vectors: Vec<(String, Entry)>) {
    let several = vectors.len() > 1;
    for (stem, mut entry) in vectors {
        if several {
            let name: String =
                stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
            entry.key = format!("vectors.{}", if name.is_empty() { "one" } else { &name });
        }
        draft.entries.push(entry);
    }
}

fn ignored(look: &CsvLook, draft: &MapDraft) -> Vec<String> {
    let used = |name: &str| {
        draft.entries.iter().any(|entry| entry.columns.iter().any(|column| column == name))
            || draft.time.as_ref().is_some_and(|time| time.value.contains(&super::lines::quoted(name)))
    };
    // Another time is no riddle to anybody.
    let is_time = |name: &str| named(name).meaning == Some(Meaning::Time);
    let names = look.columns.iter().map(|column| column.name.clone());
    names.filter(|name| !name.is_empty() && !used(name) && !is_time(name)).collect()
}
