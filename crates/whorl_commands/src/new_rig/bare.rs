//! Columns `x, y, z` of an app that writes a file for each sensor: the file's name says which, as `Gyroscope.csv`.

use std::path::Path;

use whorl_bag::CsvLook;

use super::names::{Axis, Meaning, named};
use super::table::Called;

/// What such columns are, by the names that they have. Nothing where columns say themselves what they are, or the file's name does not.
#[must_use]
pub fn by_file(look: &CsvLook, file: &Path) -> Called {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').next().unwrap_or_default();
    let Some(Meaning::Channel(sensor)) = named(stem).meaning else { return Called::new() };
    let says = |column: &str| matches!(named(column).meaning, Some(Meaning::Channel(_)));
    if look.columns.iter().any(|column| says(&column.name)) {
        return Called::new();
    }
    let with_stem = |column: &str| {
        let whole = format!("{stem} {column}");
        let seen = named(&whole);
        let is_axis = matches!(seen.axis, Some(Axis::Body(_)));
        (is_axis && seen.meaning == Some(Meaning::Channel(sensor))).then_some(whole)
    };
    let columns = look.columns.iter().filter(|column| is_bare(&column.name));
    columns.filter_map(|column| Some((column.name.clone(), with_stem(&column.name)?))).collect()
}

/// `x`, `Y`, `z (m/s^2)`.
fn is_bare(column: &str) -> bool {
    let mut rest = column.trim().chars();
    let is_axis = rest.next().is_some_and(|first| "xyzXYZ".contains(first));
    is_axis && rest.next().is_none_or(|next| !next.is_alphanumeric())
}
