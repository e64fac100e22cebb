//! The page of `whorl history RUN...`: every parameter over all runs.

use maud::Markup;
use whorl_explain::trends::{Trend, Trends};

use super::{Facts, facts};
use crate::document::{Document, text_below};
use crate::figure::Figure;
use crate::series::Curve;

/// Parameters that are drawn: those that changed most surely.
const DRAWN: usize = 24;
/// Units of the time axis and their seconds: the first that the runs span twice.
const UNITS: [(&str, f64); 3] = [("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)];

/// The page as one self-contained HTML document.
///
/// `answer`: one paragraph each; `headings` and `rows`: the table of all parameters, numeric columns begin with `#`.
#[must_use]
pub fn trends_html(
    trends: &Trends,
    answer: &[String],
    headings: &[&str],
    rows: &[Vec<String>],
    about: &Facts,
) -> String {
    let mut page = Document::new("What changed from run to run?");
    for sentence in answer {
        page.paragraph("answer", sentence);
    }
    page.heading("Parameters over the runs");
    page.paragraph(
        "rule",
        "Each run was fitted alone. Bands: one standard deviation, widened where the runs scatter more. The line is the model's \
         value.",
    );
    for trend in trends.trends.iter().take(DRAWN) {
        page.figure(&figure(trends, trend), None);
    }
    page.heading("All parameters");
    page.paragraph(
        "rule",
        "Chance: how often a change at least as clear would be seen somewhere among all that was looked at, while nothing changes.",
    );
    let cells = |row: &Vec<String>| -> Vec<Markup> {
        row.iter().zip(headings).map(|(cell, heading)| text_below(heading, cell)).collect()
    };
    page.table(headings, &rows.iter().map(cells).collect::<Vec<_>>());
    facts(&mut page, about);
    page.finish()
}

fn figure(trends: &Trends, trend: &Trend) -> Figure {
    let first = trends.runs.first().map_or(0.0, |(_, began_s)| *began_s);
    let last = trends.runs.last().map_or(0.0, |(_, began_s)| *began_s);
    let fits = UNITS.into_iter().find(|(_, seconds)| last - first >= 2.0 * seconds);
    let (word, seconds) = fits.unwrap_or(("s", 1.0));
    let time = |run: usize| trends.runs.get(run).map_or(f64::NAN, |(_, began_s)| (began_s - first) / seconds);
    let curve = |name: &str, sigmas: f64| {
        Curve::new(name, trend.estimates.iter().map(|e| (time(e.run), e.value + sigmas * e.stddev)))
    };
    let name = format!("{} {}", trend.group, trend.name);
    let unit = if trend.unit == "1" { "1" } else { trend.unit.as_str() };
    Figure {
        title: name.clone(),
        y_label: format!("{} [{unit}]", trend.name),
        x_label: format!("time since the first run [{word}]"),
        curves: vec![curve(&name, 0.0)],
        bands: vec![(curve("", -1.0), curve("", 1.0))],
        limits: vec![crate::figure::Limit { name: "model".to_owned(), value: trend.model }],
        ..Figure::default()
    }
}
