//! The page of all runs: a table that sorts and filters.

use maud::{Markup, html};

use crate::document::{Document, heading_row};

const SCRIPT: &str = include_str!("../assets/table.js");

/// Headings of the columns; those of numbers begin with `#`.
const HEADINGS: [&str; 11] = [
    "run",
    "verdict",
    "#error [deg]",
    "experiment",
    "law",
    "#seed",
    "#gas [g]",
    "#safe [s]",
    "#length [s]",
    "start",
    "effects of the models",
];

/// A run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IndexRow {
    /// In the order run, verdict, error \[deg\], experiment, law, seed, gas \[g\], safe \[s\], length \[s\], start, effects.
    pub cells: Vec<String>,
    /// Its own page.
    pub link: Option<String>,
    /// Whether its verdict is that it failed.
    pub failed: bool,
    /// Its verdict in a sentence.
    pub because: String,
}

/// A campaign.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IndexedCampaign {
    /// Its folder's name.
    pub name: String,
    /// How many of its runs are done.
    pub runs_done: usize,
    /// Its page.
    pub link: Option<String>,
}

/// The page.
#[must_use]
pub fn index_html(title: &str, rows: &[IndexRow], campaigns: &[IndexedCampaign]) -> String {
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
    if !campaigns.is_empty() {
        page.heading("Campaigns");
        page.add(html! {
            ul {
                @for campaign in campaigns {
                    li {
                        @match &campaign.link {
                            Some(link) => a href=(address(link)) { (campaign.name) },
                            None => (campaign.name),
                        }
                        ": " (campaign.runs_done) " runs done"
                    }
                }
            }
        });
    }
    page.script(SCRIPT);
    page.finish()
}

/// The address of a file, as a page names it: what has a meaning in addresses, or is not ASCII, is encoded (RFC 3986, section 2.1), and
/// a name that looks like a scheme, as `javascript:` does, is a name.
fn address(path: &str) -> String {
    let mut address = if path.starts_with('/') { String::new() } else { "./".to_owned() };
    for byte in path.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte) {
            address.push(char::from(byte));
        } else {
            address.push_str(&format!("%{byte:02X}"));
        }
    }
    address
}

fn table_row(row: &IndexRow) -> Markup {
    html! {
        tr class=[row.failed.then_some("fault")] title=(row.because) {
            @for (cell, heading) in row.cells.iter().zip(HEADINGS) {
                td class=[heading.starts_with('#').then_some("n")] {
                    @match (&row.link, heading) {
                        (Some(link), "run") => a href=(address(link)) { (cell) },
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
    fn names_of_folders_are_names_and_no_addresses() {
        for (name, expected) in [
            ("a/report.html", "./a/report.html"),
            ("javascript:alert(1)/report.html", "./javascript%3Aalert%281%29/report.html"),
            ("a#b?c%41/report.html", "./a%23b%3Fc%2541/report.html"),
            ("/runs/a b/x", "/runs/a%20b/x"),
            ("\u{e9}\"/x", "./%C3%A9%22/x"),
        ] {
            assert_eq!(address(name), expected);
        }
    }

    #[test]
    fn runs_link_to_their_pages_and_failures_say_why() {
        let row = IndexRow {
            cells: (0..HEADINGS.len()).map(|i| format!("cell {i}")).collect(),
            link: Some("a/report.html".to_owned()),
            failed: true,
            because: "FAILED: safe mode".to_owned(),
        };
        let campaign = IndexedCampaign {
            name: "link".to_owned(),
            runs_done: 7,
            link: Some("link/percentiles.html".to_owned()),
        };
        let page = index_html("Runs", &[row], &[campaign]);
        assert!(page.contains("<a href=\"./a/report.html\">cell 0</a>"), "{page}");
        assert!(page.contains("<a href=\"./link/percentiles.html\">link</a>: 7 runs done"), "{page}");
        assert!(page.contains("<tr class=\"fault\" title=\"FAILED: safe mode\">"));
        assert!(page.contains("1 runs, 1 failed"));
    }
}
