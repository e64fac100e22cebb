//! A figure, drawn by Plotly. No other file depends on Plotly.

use plotly::common::{Anchor, Font, Line, Mode, Orientation, Title};
use plotly::configuration::DisplayModeBar;
use plotly::layout::{Axis, Legend, Margin, Shape, ShapeLayer, ShapeType};
use plotly::{Configuration, Layout, Plot, Scatter};

use crate::metrics::Interval;
use crate::series::Curve;

/// Largest number of points per curve; longer curves are thinned.
const POINTS: usize = 2400;

/// Height of a figure without its legend.
const HEIGHT_PX: usize = 280;
const LEGEND_ROW_PX: usize = 20;
/// Minimum width of a legend's row, width of its line and gap, and width of a letter.
const LEGEND_WIDTH_PX: usize = 800;
const LEGEND_LINE_PX: usize = 50;
const LETTER_PX: usize = 7;

/// Line colours and dashes that can be distinguished in grey and by colour-blind readers (Okabe-Ito).
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#999933"];

/// A figure to be drawn.
#[derive(Debug, Clone, Default)]
pub struct Figure {
    /// Heading above it.
    pub title: String,
    /// One sentence on how to read it.
    pub caption: String,
    /// Quantity and unit on the vertical axis.
    pub y_label: String,
    /// Solid curves.
    pub curves: Vec<Curve>,
    /// Dashed curves, coloured like the solid curve of the same position.
    pub dashed: Vec<Curve>,
    /// Bands drawn as shaded areas, coloured like the solid curve of the same position: lower and upper edge.
    pub bands: Vec<(Curve, Curve)>,
    /// Quantity and unit on the horizontal axis; empty: time.
    pub x_label: String,
    /// Logarithmic vertical axis.
    pub log: bool,
    /// Logarithmic horizontal axis.
    pub log_x: bool,
    /// The vertical axis is scaled to the data after this time \[s\], so that an initial transient does
    /// not flatten the rest; zooming out shows everything.
    pub fitted_from_s: Option<f64>,
}

impl Figure {
    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        self.curves.iter().chain(&self.dashed).all(|c| c.time_s.is_empty())
    }

    /// Number of rows of the legend.
    fn legend_rows(&self) -> usize {
        let shown = || self.curves.iter().chain(&self.dashed).filter(|c| !c.time_s.is_empty());
        // Entries are laid out in columns as wide as the widest entry.
        let widest = shown().map(|c| c.name.chars().count() * LETTER_PX + LEGEND_LINE_PX).max().unwrap_or(1);
        shown().count().div_ceil((LEGEND_WIDTH_PX / widest).max(1))
    }

    /// Smallest and largest value from this time on.
    fn range_from(&self, start_s: f64) -> Option<[f64; 2]> {
        let points = self.curves.iter().chain(&self.dashed).flat_map(|c| c.time_s.iter().zip(&c.value));
        let late = points.filter(|(t, v)| **t >= start_s && v.is_finite()).map(|(_, v)| *v);
        let [low, high] =
            late.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        (low <= high).then_some([low, high])
    }

    /// HTML of the figure; `shaded` stretches of time are drawn in grey behind the curves;
    /// without a range the horizontal axis is fitted to the curves.
    pub fn html(&self, id: &str, shaded: &[Interval], x_range: Option<(f64, f64)>) -> String {
        let mut plot = Plot::new();
        for (index, (lower, upper)) in self.bands.iter().enumerate().filter(|(_, b)| !b.0.time_s.is_empty()) {
            let colour = COLOURS.get(index % COLOURS.len()).copied().unwrap_or("#000000");
            let edge = |curve: &Curve| {
                Scatter::new(rounded(curve.time_s.clone()), rounded(curve.value.clone()))
                    .mode(Mode::Lines)
                    .line(Line::new().color(colour).width(0.0))
                    .show_legend(false)
                    .hover_info(plotly::common::HoverInfo::Skip)
            };
            plot.add_trace(edge(lower));
            plot.add_trace(edge(upper).fill(plotly::common::Fill::ToNextY).fill_color(format!("{colour}2a")));
        }
        let solid = self.curves.iter().enumerate().map(|(i, c)| (i, c, "solid", 1.6));
        let dashed = self.dashed.iter().enumerate().map(|(i, c)| (i, c, "dash", 1.2));
        for (index, curve, dash, width) in solid.chain(dashed).filter(|(_, c, ..)| !c.time_s.is_empty()) {
            let curve = curve.clone().thinned(POINTS);
            let colour = COLOURS.get(index % COLOURS.len()).copied().unwrap_or("#000000");
            let dash =
                if dash == "dash" { plotly::common::DashType::Dash } else { plotly::common::DashType::Solid };
            let line = Line::new().color(colour).width(width).dash(dash);
            plot.add_trace(
                Scatter::new(rounded(curve.time_s), rounded(curve.value))
                    .mode(Mode::Lines)
                    .name(curve.name)
                    .line(line),
            );
        }
        let axis = Axis::new()
            .grid_color("#e5e5e5")
            .zero_line_color("#bbbbbb")
            .line_color("#333333")
            .show_line(true);
        let mut y = axis.clone().title(Title::with_text(self.y_label.clone()));
        if self.log {
            y = y.type_(plotly::layout::AxisType::Log);
        }
        if let Some([low, high]) = self.fitted_from_s.and_then(|t| self.range_from(t)) {
            let margin = 0.08 * (high - low).max(f64::MIN_POSITIVE);
            y = y.range(vec![low - margin, high + margin]);
        }
        let x_label = if self.x_label.is_empty() { "time [s]" } else { self.x_label.as_str() };
        let mut x = axis.title(Title::with_text(x_label));
        if self.log_x {
            x = x.type_(plotly::layout::AxisType::Log);
        } else if let Some((first, last)) = x_range {
            x = x.range(vec![first, last]);
        }
        let shapes = shaded.iter().map(|(start, end)| {
            Shape::new()
                .shape_type(ShapeType::Rect)
                .x_ref("x")
                .y_ref("paper")
                .x0(*start)
                .x1(*end)
                .y0(0)
                .y1(1)
                .fill_color("#eef2f7")
                .layer(ShapeLayer::Below)
                .line(plotly::layout::ShapeLine::new().width(0.))
        });
        plot.set_layout(
            Layout::new()
                .height(HEIGHT_PX + LEGEND_ROW_PX * self.legend_rows())
                .margin(Margin::new().top(10).bottom(45).left(70).right(15))
                .paper_background_color("#ffffff")
                .plot_background_color("#ffffff")
                .legend(
                    Legend::new()
                        .orientation(Orientation::Horizontal)
                        .font(Font::new().size(11))
                        // Placed above the plot, in its margin, so that it never covers curves.
                        .y_anchor(Anchor::Bottom)
                        .y(1.02)
                        .x(0.),
                )
                .x_axis(x)
                .y_axis(y)
                .shapes(shapes.collect()),
        );
        plot.set_configuration(
            Configuration::new().responsive(true).display_mode_bar(DisplayModeBar::Hover).display_logo(false),
        );
        plot.to_inline_html(Some(id))
    }
}

/// The script that draws the figures, for embedding once in a page.
///
/// The library's sources also contain a typesetter for formulas, which is half of their size and not
/// needed here.
pub fn script() -> String {
    let sources = Plot::offline_js_sources();
    sources.split_once("</script>").map_or(sources.clone(), |(plotly, _)| format!("{plotly}</script>"))
}

/// Six significant digits: enough for a plot, at a third of the size.
fn rounded(values: Vec<f64>) -> Vec<f64> {
    values
        .into_iter()
        .map(|x| if x == 0.0 || !x.is_finite() { x } else { format!("{x:.5e}").parse().unwrap_or(x) })
        .collect()
}
