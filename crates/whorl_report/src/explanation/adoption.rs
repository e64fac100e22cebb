//! The page of `whorl adopt`.

use maud::Markup;
use whorl_explain::Adoption;

use super::versions::versions;
use super::{Facts, facts};
use crate::document::{Document, code, significant, text};

/// The page as one self-contained HTML document.
#[must_use]
pub fn adoption_html(adoption: &Adoption, about: &Facts) -> String {
    let mut page = Document::new("What does the effect bring?");
    for sentence in adoption.answer() {
        page.paragraph("answer", &sentence);
    }
    versions(&mut page, &adoption.versions);
    page.heading("Parameters");
    let adopted = adoption.versions.last().and_then(|v| v.fit.as_ref());
    let rows: Vec<Vec<Markup>> = adopted
        .iter()
        .flat_map(|fit| &fit.estimates)
        .map(|p| {
            vec![
                code(&p.group),
                code(&p.name),
                text(&p.unit),
                significant(p.before),
                significant(p.estimate),
                significant(p.stddev),
            ]
        })
        .collect();
    page.table(&["of", "parameter", "unit", "#before", "#after", "#standard deviation"], &rows);
    facts(&mut page, about);
    page.finish()
}
