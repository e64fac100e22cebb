//! The map of a CSV file as a form: which column is which axis, its sign, its unit.

use anyhow::{Context as _, Result, bail};
use whorl_bag::{Channel, CsvMap};
use whorl_commands::runs::is_csv;
use whorl_params::{ParameterTree, Value, set_in_text};
use whorl_recording::platform_parts;

use crate::api::{ChannelMap, FileChange, FileKind, MapRow, SetChannel};
use crate::bench::{Workbench, change_of};

/// Lines of the recording that are looked at for its columns.
const LOOKED_AT: usize = 50;
/// The map's own section.
const SECTION: &str = "csv";

/// The chosen map, and the columns of the first chosen run.
///
/// # Errors
/// When either cannot be read.
pub fn map(bench: &Workbench) -> Result<ChannelMap> {
    let choice = bench.choice();
    let file = choice.channels.context("no map is chosen")?;
    let entries = ParameterTree::load_for(&bench.listed(&file, FileKind::Map)?, SECTION)?;
    let texts = |key: String| match entries.get(&key).map(|entry| &entry.value) {
        Some(Value::StringArray(list)) => Some(list.clone()),
        Some(Value::String(one)) => Some(vec![one.clone()]),
        _ => None,
    };
    let row = |channel: &Channel| {
        let info = channel.info();
        Some(MapRow {
            key: info.key.to_owned(),
            columns: texts(format!("{}.columns", info.key))?,
            unit: texts(format!("{}.unit", info.key)).and_then(|unit| unit.first().cloned()),
            units: info.units.iter().map(|unit| unit.name.to_owned()).collect(),
        })
    };
    let run = choice.runs.iter().chain(&choice.held_out).map(|run| bench.folder().join(run));
    let table = run.into_iter().find(|path| is_csv(path));
    let columns = match table {
        Some(path) => {
            whorl_bag::look(&path, LOOKED_AT)?.columns.into_iter().map(|column| column.name).collect()
        }
        None => Vec::new(),
    };
    Ok(ChannelMap { file, rows: Channel::ALL.iter().filter_map(row).collect(), columns })
}

/// Writes the columns and the unit of a channel into the map.
///
/// # Errors
/// A channel that the map does not have, a unit or columns that it may not have; then the file is as before.
pub fn set_channel(bench: &Workbench, wanted: &SetChannel) -> Result<Option<FileChange>> {
    let shown = map(bench)?;
    let Some(row) = shown.rows.iter().find(|row| row.key == wanted.key) else {
        let known: Vec<&str> = shown.rows.iter().map(|row| row.key.as_str()).collect();
        bail!("the map has no channel {:?}; there are {}", wanted.key, known.join(", "));
    };
    if wanted.columns.len() != row.columns.len() {
        bail!("{}: {} columns, as before, are allowed", row.key, row.columns.len());
    }
    let path = bench.listed(&shown.file, FileKind::Map)?;
    let before = whorl_files::read_text(&path)?;
    let columns = Value::StringArray(wanted.columns.clone());
    let mut text =
        set_in_text(&shown.file, &before, SECTION, &format!("{}.columns", row.key), &columns, None)?;
    if let Some(unit) = &wanted.unit {
        let unit = Value::String(unit.clone());
        text = set_in_text(&shown.file, &text, SECTION, &format!("{}.unit", row.key), &unit, None)?;
    }
    whorl_files::write_file(&path, &text)?;
    let known = bench.known();
    let read = known.and_then(|known| Ok(CsvMap::load_for(&path, &platform_parts(&known))?));
    if let Err(error) = read {
        whorl_files::write_file(&path, &before)?;
        return Err(error);
    }
    Ok(change_of(bench.folder(), &shown.file, Some(before)))
}
