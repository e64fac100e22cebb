//! Percentile plots as one page that opens offline.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::plan::Plan;
use crate::row::{MEANINGS, METRICS};
use crate::table::{Group, PERCENTILES};

const STYLE: &str = "
body{font:15px/1.5 system-ui,sans-serif;max-width:960px;margin:2em auto;color:#1c2733}
table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}
td,th{padding:2px 9px;text-align:right;border-bottom:1px solid #e3e8ee;white-space:nowrap}
td:first-child,th:first-child,td.why{text-align:left}
td.why{white-space:normal;min-width:16em}
svg text{font-size:12px}
";

const WIDTH: f64 = 900.0;
const ROW_HEIGHT: f64 = 22.0;
const LABEL_WIDTH: f64 = 370.0;

/// The page: a plot for each metric that the campaign names, and the table of medians.
#[must_use]
pub fn html(plan: &Plan, groups: &[Group]) -> String {
    let title = format!("Campaign: {}", plan.definition.name);
    let runs = groups.iter().map(|g| g.runs).sum::<usize>();
    let plots = plan.definition.plots.iter().filter_map(|metric| {
        let index = METRICS.iter().position(|m| m == metric)?;
        Some(plot(metric, index, groups))
    });
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                p { (runs) " runs. Bars: 5th to 95th percentile over seeds; mark: median." }
                @for plot in plots { (plot) }
                (medians(groups))
            }
        }
    };
    page.into_string()
}

/// Label of a group: what distinguishes it from the others; the experiment only if there are several.
fn label(group: &Group, groups: &[Group]) -> String {
    let several = groups.iter().any(|other| other.experiment != group.experiment);
    let experiment = (several || group.labels.is_empty()).then_some(group.experiment.as_str());
    let parts: Vec<&str> = experiment.into_iter().chain(group.labels.iter().map(String::as_str)).collect();
    parts.join(" · ")
}

fn plot(metric: &str, index: usize, groups: &[Group]) -> Markup {
    let values = |g: &Group| g.percentiles.get(index).copied().unwrap_or([f64::NAN; PERCENTILES.len()]);
    let largest = groups.iter().flat_map(values).filter(|v| v.is_finite()).fold(0.0, f64::max);
    let scale = if largest > 0.0 { (WIDTH - LABEL_WIDTH - 90.0) / largest } else { 0.0 };
    let height = ROW_HEIGHT * (groups.len() as f64 + 1.5);
    html! {
        h2 { (metric) }
        p { (MEANINGS.get(index).copied().unwrap_or_default()) }
        svg viewBox=(format!("0 0 {WIDTH} {height}")) width="100%" role="img" {
            @for (k, group) in groups.iter().enumerate() {
                (bar(&label(group, groups), values(group), scale, ROW_HEIGHT * (k as f64 + 0.8)))
            }
        }
    }
}

/// One group of a plot: label, bar, mark and number, with its baseline at `y`.
fn bar(label: &str, [low, median, high]: [f64; PERCENTILES.len()], scale: f64, y: f64) -> Markup {
    let one = |v: f64| format!("{v:.1}");
    let x = |v: f64| LABEL_WIDTH + v * scale;
    html! {
        text x=(LABEL_WIDTH - 8.0) y=(one(y)) text-anchor="end" { (label) }
        @if median.is_finite() {
            rect x=(one(x(low))) y=(one(y - 9.0)) width=(one(((high - low) * scale).max(1.0))) height="10" rx="2"
                fill="#a8c5e6" {}
            rect x=(one(x(median) - 1.5)) y=(one(y - 11.0)) width="3" height="14" fill="#1f4e8c" {}
            text x=(one(x(high) + 8.0)) y=(one(y)) { (short(median)) }
        } @else {
            text x=(LABEL_WIDTH) y=(one(y)) fill="#7b8794" { "none" }
        }
    }
}

fn medians(groups: &[Group]) -> Markup {
    html! {
        h2 { "Medians" }
        table {
            tr {
                @for heading in ["group", "runs", "finished", "otherwise"].iter().chain(&METRICS) {
                    th { (heading) }
                }
            }
            @for group in groups {
                tr {
                    td { (label(group, groups)) }
                    td { (group.runs) }
                    td { (group.finished) }
                    td class="why" { (group.otherwise) }
                    @for [_, median, _] in &group.percentiles {
                        td { (short(*median)) }
                    }
                }
            }
        }
    }
}

/// Three significant digits.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 6);
    format!("{value:.*}", usize::try_from(digits).unwrap_or(0))
}
