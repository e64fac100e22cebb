//! Tables in plain text.

use std::borrow::Cow;

use whorl_math::words::one_line;

use crate::output::say;

/// Prints rows under headings, columns as wide as needed; columns whose heading begins with `#` are
/// right-aligned. A cell has one line, whatever stands in it.
pub fn print(headings: &[String], rows: &[Vec<String>]) {
    let rows: Vec<Vec<Cow<'_, str>>> =
        rows.iter().map(|row| row.iter().map(|cell| one_line(cell)).collect()).collect();
    let width = |column: usize, heading: &str| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells
            .map(|c| c.chars().count())
            .chain([heading.trim_start_matches('#').chars().count()])
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = headings.iter().enumerate().map(|(k, h)| width(k, h)).collect();
    let line = |cells: &[Cow<'_, str>]| {
        let mut text = String::from(" ");
        for ((cell, width), heading) in cells.iter().zip(&widths).zip(headings) {
            let cell = cell.trim_start_matches('#');
            text.push(' ');
            if heading.starts_with('#') {
                text.push_str(&format!("{cell:>width$}"));
            } else {
                text.push_str(&format!("{cell:<width$}"));
            }
            text.push(' ');
        }
        text.trim_end().to_owned()
    };
    say!("{}", line(&headings.iter().map(|heading| heading.as_str().into()).collect::<Vec<_>>()));
    for row in &rows {
        say!("{}", line(row));
    }
}
