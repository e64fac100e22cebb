//! The HTML report of a run, and the numbers in it.
//!
//! [`Collector`] takes recorded messages, [`RunData`] is what it keeps of them, [`summarise`] computes the numbers, [`html`] writes the page:
//! one file that opens offline. The pages that explain data ([`comparison_html`], [`localisation_html`],
//! [`diagnosis_html`], [`adoption_html`]) are built in the same way.

pub mod assets;
mod campaign;
mod data;
mod document;
mod events;
mod explanation;
mod figure;
mod figures;
mod frames;
mod index;
mod live;
mod metrics;
mod orbit;
mod orbit_keeping;
mod overlay;
mod page;
mod pair;
mod platform;
mod replay;
mod reproduction;
mod series;
mod siblings;
mod svg;
mod timeline;
mod times;
mod verdict;

#[cfg(test)]
mod memory_tests;

pub use campaign::{Sweep, SweptAxis, SweptGroup, campaign_html};
pub use data::{Collector, RunData};
pub use events::{Happening, happenings, mode_name};
pub use explanation::{
    Drawn, Facts, NextPage, PathPart, PlannedMotion, SHARES, adoption_figures, adoption_html,
    comparison_figures, comparison_html, diagnosis_figures, diagnosis_html, discovery_html, horizon_columns,
    localisation_figures, localisation_html, next_html, path_html, shares, trends_html,
};
pub use index::{IndexRow, IndexedCampaign, index_html};
pub use live::live_html;
pub use metrics::{PairSummary, PlatformSummary, Summary, phase_name, summarise};
pub use orbit::{DrawnBurn, DrawnCraft, DrawnPass, orbit_html};
pub use orbit_keeping::{DrawnCorrection, DrawnKeeping};
pub use overlay::{
    MOST_RUNS as MOST_OVERLAID, PairDifference, ParameterDifference, overlay_html, pair_differences,
};
pub use page::{Description, TopicRow, html};
pub use platform::PlatformData;
pub use replay::{JetShape, KeepOut, PlatformShape, TiltLimit, alarming};
pub use reproduction::{NamedPoints, ReproducedPlot, Reproduction, reproduction_html};
pub use siblings::link_pages;
pub use times::Recorded;
pub use verdict::{Circumstances, Result as RunResult, Verdict as RunVerdict, judge, measured};
