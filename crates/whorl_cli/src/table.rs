//! Tables in plain text.

use crate::output::say;

/// Prints rows under headings, columns as wide as needed; columns whose heading begins with `#` are
/// right-aligned.
pub fn print(headings: &[String], rows: &[Vec<String>]) {
    let width = |column: usize, heading: &str| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells
            .map(|c| c.chars().count())
            .chain([heading.trim_start_matches('#').chars().count()])
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = headings.iter().enumerate().map(|(k, h)| width(k, h)).collect();
    let line = |cells: &[String]| {
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
    say!("{}", line(headings));
    for row in rows {
        say!("{}", line(row));
    }
}
