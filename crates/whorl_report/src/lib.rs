//! The HTML report of a run, and the numbers in it.
//!
//! [`RunData`] takes recorded messages, [`summarise`] computes the numbers, [`html`] draws the page:
//! one file that opens offline.

mod data;
mod events;
mod figure;
mod figures;
mod metrics;
mod page;
mod series;

pub use data::{PlatformData, Recorded, RunData};
pub use events::{Happening, happenings};
pub use metrics::{PairSummary, PlatformSummary, Summary, phase_name, summarise};
pub use page::{Description, TopicRow, html};
