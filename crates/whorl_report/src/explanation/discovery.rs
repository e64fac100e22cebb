//! The page of a search for a law.

use whorl_identification::Discovery;

use super::{Facts, facts};
use crate::document::{Document, number, text};

/// The page of `whorl discover`: `answer` in sentences, and everything that was weighed.
#[must_use]
pub fn discovery_html(found: &Discovery, answer: &[String], about: &Facts) -> String {
    let mut page = Document::new("Which law is missing?");
    for sentence in answer {
        page.paragraph("answer", sentence);
    }
    page.heading("Laws that were weighed");
    page.paragraph(
        "rule",
        "Each was fitted where it fits best, beside the platform's own parameters, and weighed with all runs. The log evidence \
         is that over the model as it is; what the symbols of a law cost is in the probability.",
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
