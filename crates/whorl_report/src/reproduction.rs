//! The page of reproduced figures and tables.

use maud::Markup;

use crate::document::{Document, text_below};
use crate::figure::Figure;
use crate::series::Curve;

/// One figure or table of a publication, reproduced.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reproduction {
    /// Name on the command line, such as `table_4_3`.
    pub name: String,
    /// Heading.
    pub title: String,
    /// Headings and rows of its table, if it has one; headings of numeric columns begin with `#`.
    pub table: Option<(Vec<String>, Vec<Vec<String>>)>,
    /// Its plots.
    pub plots: Vec<ReproducedPlot>,
    /// Differences from the printed values and their reasons, one sentence each.
    pub sentences: Vec<String>,
}

/// A curve: legend and points.
pub type NamedPoints = (String, Vec<(f64, f64)>);

/// One plot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReproducedPlot {
    /// Heading.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// Quantities and units on the axes, horizontal first.
    pub labels: [String; 2],
    /// Which axes are logarithmic, horizontal first.
    pub logarithmic: [bool; 2],
    /// Solid curves.
    pub curves: Vec<NamedPoints>,
    /// Dashed curves, coloured like the solid curve of the same position.
    pub dashed: Vec<NamedPoints>,
    /// Lower and upper edge of a band in which all curves should stay.
    pub band_of_all: Option<[Vec<(f64, f64)>; 2]>,
}

/// The page of all reproductions.
#[must_use]
pub fn reproduction_html(title: &str, introduction: &str, items: &[Reproduction]) -> String {
    let mut page = Document::new(title);
    page.paragraph("", introduction);
    for item in items {
        page.heading(&item.title);
        if let Some((headings, rows)) = &item.table {
            let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
            let cells =
                |row: &Vec<String>| row.iter().zip(&headings).map(|(c, h)| text_below(h, c)).collect();
            let rows: Vec<Vec<Markup>> = rows.iter().map(cells).collect();
            page.table(&headings, &rows);
        }
        for plot in &item.plots {
            page.figure(&figure(plot), None);
        }
        page.list(&item.sentences);
    }
    page.finish()
}

fn figure(plot: &ReproducedPlot) -> Figure {
    let curves = |all: &[NamedPoints]| -> Vec<Curve> {
        all.iter().map(|(name, points)| Curve::new(name.clone(), points.iter().copied())).collect()
    };
    let [x_label, y_label] = plot.labels.clone();
    let edge = |points: &[(f64, f64)]| Curve::new(String::new(), points.iter().copied());
    Figure {
        band_of_all: plot.band_of_all.as_ref().map(|[lower, upper]| (edge(lower), edge(upper))),
        title: plot.title.clone(),
        caption: plot.caption.clone(),
        y_label,
        x_label,
        curves: curves(&plot.curves),
        dashed: curves(&plot.dashed),
        log: plot.logarithmic[1],
        log_x: plot.logarithmic[0],
        ..Figure::default()
    }
}
