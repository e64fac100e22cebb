//! Percentile plots as one page that opens offline.

use std::fmt::Write;

use crate::plan::Plan;
use crate::row::{MEANINGS, METRICS};
use crate::table::{Group, PERCENTILES};

const WIDTH: f64 = 900.0;
const ROW_HEIGHT: f64 = 22.0;
const LABEL_WIDTH: f64 = 370.0;

/// The page: a plot for each metric that the campaign names, and the table of medians.
#[must_use]
pub fn html(plan: &Plan, groups: &[Group]) -> String {
    let name = escaped(&plan.definition.name);
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Campaign: {name}</title><style>\
         body{{font:15px/1.5 system-ui,sans-serif;max-width:960px;margin:2em auto;color:#1c2733}}\
         table{{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}}td,th{{padding:2px 9px;text-align:right;\
         border-bottom:1px solid #e3e8ee;white-space:nowrap}}td:first-child,th:first-child,td.why{{text-align:left}}td.why{{white-space:normal;min-width:16em}}svg text{{font-size:12px}}</style>\
         <h1>Campaign: {name}</h1><p>{} runs. Bars: 5th to 95th percentile over seeds; mark: median.</p>",
        groups.iter().map(|g| g.runs).sum::<usize>()
    );
    for metric in &plan.definition.plots {
        if let Some(index) = METRICS.iter().position(|m| m == metric) {
            plot(&mut page, metric, index, groups);
        }
    }
    medians(&mut page, groups);
    page.push_str("</html>\n");
    page
}

/// Label of a group: what distinguishes it from the others; the experiment only if there are several.
fn label(group: &Group, groups: &[Group]) -> String {
    let several = groups.iter().any(|other| other.experiment != group.experiment);
    let experiment = (several || group.labels.is_empty()).then_some(group.experiment.as_str());
    let parts: Vec<&str> = experiment.into_iter().chain(group.labels.iter().map(String::as_str)).collect();
    escaped(&parts.join(" · "))
}

fn plot(page: &mut String, metric: &str, index: usize, groups: &[Group]) {
    let values = |g: &Group| g.percentiles.get(index).copied().unwrap_or([f64::NAN; PERCENTILES.len()]);
    let largest = groups.iter().flat_map(values).filter(|v| v.is_finite()).fold(0.0, f64::max);
    let scale = if largest > 0.0 { (WIDTH - LABEL_WIDTH - 90.0) / largest } else { 0.0 };
    let height = ROW_HEIGHT * (groups.len() as f64 + 1.5);
    let _ = write!(
        page,
        "<h2>{}</h2><p>{}</p><svg viewBox=\"0 0 {WIDTH} {height}\" width=\"100%\" role=\"img\">",
        escaped(metric),
        escaped(MEANINGS.get(index).copied().unwrap_or_default())
    );
    for (k, group) in groups.iter().enumerate() {
        let y = ROW_HEIGHT * (k as f64 + 0.8);
        let _ = write!(
            page,
            "<text x=\"{}\" y=\"{y:.1}\" text-anchor=\"end\">{}</text>",
            LABEL_WIDTH - 8.0,
            label(group, groups)
        );
        let [low, median, high] = values(group);
        if !median.is_finite() {
            let _ = write!(page, "<text x=\"{LABEL_WIDTH}\" y=\"{y:.1}\" fill=\"#7b8794\">none</text>");
            continue;
        }
        let x = |v: f64| LABEL_WIDTH + v * scale;
        let _ = write!(
            page,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"10\" rx=\"2\" fill=\"#a8c5e6\"/>\
             <rect x=\"{:.1}\" y=\"{:.1}\" width=\"3\" height=\"14\" fill=\"#1f4e8c\"/>\
             <text x=\"{:.1}\" y=\"{y:.1}\">{}</text>",
            x(low),
            y - 9.0,
            ((high - low) * scale).max(1.0),
            x(median) - 1.5,
            y - 11.0,
            x(high) + 8.0,
            short(median)
        );
    }
    page.push_str("</svg>");
}

fn medians(page: &mut String, groups: &[Group]) {
    page.push_str(
        "<h2>Medians</h2><table><tr><th>group</th><th>runs</th><th>finished</th><th>otherwise</th>",
    );
    for metric in METRICS {
        let _ = write!(page, "<th>{metric}</th>");
    }
    page.push_str("</tr>");
    for group in groups {
        let _ = write!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=why>{}</td>",
            label(group, groups),
            group.runs,
            group.finished,
            escaped(&group.otherwise)
        );
        for [_, median, _] in &group.percentiles {
            let _ = write!(page, "<td>{}</td>", short(*median));
        }
        page.push_str("</tr>");
    }
    page.push_str("</table>");
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

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
