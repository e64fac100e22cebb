//! The HTML report of a run, and the numbers in it.
//!
//! [`RunData`] collects recorded messages, [`summarise`] computes the numbers, [`html`] writes the page:
//! one file that opens offline. The pages that explain data ([`comparison_html`], [`whereabouts_html`],
//! [`diagnosis_html`], [`adoption_html`]) are built in the same way.

mod data;
mod document;
mod events;
mod explanation;
mod figure;
mod figures;
mod metrics;
mod page;
mod reproduction;
mod series;
mod verdict;

pub use data::{PlatformData, Recorded, RunData};
pub use events::{Happening, happenings};
pub use explanation::{
    Facts, NextPage, PlannedMotion, adoption_html, comparison_html, diagnosis_html, discovery_html,
    next_html, whereabouts_html,
};
pub use metrics::{PairSummary, PlatformSummary, Summary, phase_name, summarise};
pub use page::{Description, TopicRow, html};
pub use reproduction::{NamedPoints, ReproducedPlot, Reproduction, reproduction_html};
pub use verdict::{Circumstances, Result as RunResult, Verdict, judge};
