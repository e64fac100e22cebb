//! The page of a search for a law.

use whorl_identification::{Discovery, Drawn};

use super::{Facts, facts};
use crate::document::{Document, number, text};
use crate::figure::Figure;
use crate::series::Curve;

/// The page of `whorl discover`: `answer` in sentences, the best law over the data, and everything that was weighed.
#[must_use]
pub fn discovery_html(found: &Discovery, answer: &[String], about: &Facts) -> String {
    let mut page = Document::new("Which law is missing?");
    for sentence in answer {
        page.paragraph("answer", sentence);
    }
    if let Some(drawn) = &found.drawn {
        page.heading("The law over the data");
        page.figure(&figure(drawn), None);
    }
    page.heading("Laws that were weighed");
    page.paragraph(
        "rule",
        "Each was fitted where it fits best, beside the platform's own parameters, and weighed with all runs. The log evidence \
         is that over the model as it is; what the symbols of a law cost is in the probability. `curve` is a measured curve: \
         it predicts, and explains nothing.",
    );
    let rows: Vec<Vec<maud::Markup>> = found
        .laws
        .iter()
        .map(|law| {
            vec![
                text(law.kind),
                number(100.0 * law.probability, 1),
                number(law.log_evidence, 1),
                law.held_out_gain.map_or_else(|| text("-"), |gain| number(gain, 1)),
                number(1e3 * law.background_n_m, 3),
                crate::document::code(&law.equation),
                text(&law.sentence),
            ]
        })
        .collect();
    let headings = [
        "",
        "#probability %",
        "#log evidence",
        "#held out",
        "#random torque left mN m",
        "equation",
        "in words",
    ];
    page.table(&headings, &rows);
    facts(&mut page, about);
    page.finish()
}

pub(super) fn figure(drawn: &Drawn) -> Figure {
    let curve = |name: &str, of: &dyn Fn(&whorl_identification::DrawnPoint) -> Option<f64>| {
        Curve::new(name, drawn.points.iter().filter_map(|p| Some((p.at, 1e3 * of(p)?))))
    };
    let band = |sign: f64| curve("", &move |p| Some(p.torque_n_m + sign * 2.0 * p.stddev_n_m));
    Figure {
        title: format!("Torque that the model lacks, {}", drawn.direction),
        caption: "Measured: a regression on the variable in bins, beside the platform's own parameters, with a band of two \
                  standard deviations. What is constant in it may be part of the model's own parameters. Dashed: the law."
            .to_owned(),
        y_label: "torque [mN m]".to_owned(),
        x_label: drawn.variable.clone(),
        curves: vec![curve("measured", &|p| Some(p.torque_n_m))],
        dashed: vec![curve("law", &|p| p.law_n_m)],
        bands: vec![(band(-1.0), band(1.0))],
        ..Figure::default()
    }
}
