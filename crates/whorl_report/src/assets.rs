//! Scripts and styles that pages embed, so that they open without a network.
//!
//! The live view serves the same ones.

/// uPlot, the library that draws the figures (MIT): its licence stands beside it in the pages.
pub const UPLOT: &str = include_str!("../assets/uplot/uPlot.iife.min.js");
/// Its style.
pub const UPLOT_STYLE: &str = include_str!("../assets/uplot/uPlot.min.css");
/// Its licence.
pub const UPLOT_LICENCE: &str = include_str!("../assets/uplot/LICENSE");
/// Style of all pages.
pub const STYLE: &str = include_str!("../assets/page.css");
/// Figures with one cursor and one zoom.
pub const PLOTS: &str = include_str!("../assets/plots.js");
/// Platforms in three dimensions.
pub const SCENE: &str = include_str!("../assets/scene.js");
/// Plays a recording.
pub(crate) const REPLAY: &str = include_str!("../assets/replay.js");
/// Draws what a page holds.
pub(crate) const PAGE: &str = include_str!("../assets/page.js");
/// Shows a running formation.
pub(crate) const LIVE: &str = include_str!("../assets/live.js");
