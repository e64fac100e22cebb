//! Pages that explain data: how far off a model is, where it fails, what is missing, how adopting it improves the
//! model, and what to do next.

mod adoption;
mod comparison;
mod diagnosis;
mod discovery;
mod drawn;
mod localisation;
mod path;
mod proposal;
mod trends;
mod versions;

pub use adoption::adoption_html;
pub use comparison::{comparison_html, horizon_columns};
pub use diagnosis::diagnosis_html;
pub use discovery::discovery_html;
pub use drawn::{Drawn, adoption_figures, comparison_figures, diagnosis_figures, localisation_figures};
pub use localisation::{SHARES, localisation_html, shares};
pub use path::{PathPart, path_html};
pub use proposal::{NextPage, PlannedMotion, next_html};
pub use trends::trends_html;

use crate::document::Document;
use maud::Markup;

/// Facts about a page: label and value, in order (model, command, versions, ...).
pub type Facts = [(String, String)];

pub(crate) fn facts(page: &mut Document, facts: &Facts) {
    if facts.is_empty() {
        return;
    }
    page.heading("What was compared");
    let rows: Vec<Vec<Markup>> = facts
        .iter()
        .map(|(label, value)| vec![crate::document::text(label), crate::document::code(value)])
        .collect();
    page.table(&["", ""], &rows);
}
