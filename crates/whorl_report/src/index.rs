//! The page of all runs: a table that sorts and filters.

use maud::{Markup, html};

use crate::document::{Document, heading_row};

const SCRIPT: &str = include_str!("../assets/table.js");

/// Headings of the columns; those of numbers begin with `#`.
const HEADINGS: [&str; 11] = [
    "start",
    "run",
    "experiment",
    "law",
    "#seed",
    "verdict",
    "#error [deg]",
    "#gas [g]",
    "#safe [s]",
    "#length [s]",
    "effects of the models",
];

/// A run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IndexRow {
    /// In the order start, run, experiment, law, seed, verdict, error \[deg\], gas \[g\], safe \[s\], length \[s\], effects.
    pub cells: Vec<String>,
    /// Its own page.
    pub link: Option<String>,
    /// Whether its verdict is that it failed.
    pub failed: bool,
    /// Its verdict in a sentence.
    pub because: String,
}

/// The page.
#[must_use]
pub fn index_html(title: &str, rows: &[IndexRow]) -> String {
    let mut page = Document::new(title);
    let failed = rows.iter().filter(|row| row.failed).count();
    page.paragraph("", &format!("{} runs, {failed} failed. A click on a heading sorts.", rows.len()));
    page.add(html! {
        p { label { "Show rows that contain " input id="filter" type="search" autocomplete="off"; } " " span id="count" role="status" {} }
        div class="wide" {
            table id="runs" {
                thead { (heading_row(&HEADINGS)) }
                tbody { @for row in rows { (table_row(row)) } }
            }
        }
    });
    page.script(SCRIPT);
    page.finish()
}

fn table_row(row: &IndexRow) -> Markup {
    html! {
        tr class=[row.failed.then_some("fault")] title=(row.because) {
            @for (cell, heading) in row.cells.iter().zip(HEADINGS) {
                td class=[heading.starts_with('#').then_some("n")] {
                    @match (&row.link, heading) {
                        (Some(link), "run") => a href=(link) { (cell) },
                        _ => (cell),
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_link_to_their_pages_and_failures_say_why() {
        let row = IndexRow {
            cells: (0..HEADINGS.len()).map(|i| format!("cell {i}")).collect(),
            link: Some("a/report.html".to_owned()),
            failed: true,
            because: "FAILED: safe mode".to_owned(),
        };
        let page = index_html("Runs", &[row]);
        assert!(page.contains("<a href=\"a/report.html\">cell 1</a>"), "{page}");
        assert!(page.contains("<tr class=\"fault\" title=\"FAILED: safe mode\">"));
        assert!(page.contains("1 runs, 1 failed"));
    }
}
