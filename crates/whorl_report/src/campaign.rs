//! The page of a campaign: fans over what was swept, heat maps over two swept numbers, bars for what has no order.

use maud::{Markup, html};
use whorl_math::three_digits;

use crate::document::{Document, right, text};
use crate::figure::Figure;
use crate::series::Curve;

/// The strongest colour is for cells that differ by at least this share of the largest \[1\].
const FULL_COLOUR: f64 = 0.25;
/// Strongest colour of a heat map: text stays readable on it, in light and dark.
const STRONGEST_PERCENT: f64 = 45.0;

/// A swept quantity.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SweptAxis {
    /// Its name, with its unit at the end: `delay_s`.
    pub name: String,
    /// Labels of its values, in order.
    pub labels: Vec<String>,
}

/// Runs that differ only in their seed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SweptGroup {
    /// Their experiment.
    pub experiment: String,
    /// Their label on each axis.
    pub labels: Vec<String>,
    /// Number of runs, and of those that finished.
    pub runs: [usize; 2],
    /// Why the first that did not finish did not; empty if all did.
    pub otherwise: String,
    /// Per metric: 5th, 50th and 95th percentile over the runs; NaN if none has it.
    pub percentiles: Vec<[f64; 3]>,
}

/// Everything of a campaign that its page shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sweep {
    /// Its name.
    pub name: String,
    /// What was swept.
    pub axes: Vec<SweptAxis>,
    /// The groups, in the order of the table.
    pub groups: Vec<SweptGroup>,
    /// Name and meaning (with unit) of every metric.
    pub metrics: Vec<(String, String)>,
    /// Positions of the metrics that are drawn.
    pub drawn: Vec<usize>,
}

/// The page.
#[must_use]
pub fn campaign_html(sweep: &Sweep) -> String {
    let mut page = Document::new(&format!("Campaign: {}", sweep.name));
    let runs: usize = sweep.groups.iter().map(|group| group.runs[0]).sum();
    let finished: usize = sweep.groups.iter().map(|group| group.runs[1]).sum();
    let swept: Vec<String> =
        sweep.axes.iter().map(|axis| format!("{} ({})", axis.name, axis.labels.join(", "))).collect();
    let swept = if swept.is_empty() { String::new() } else { format!(" Swept: {}.", swept.join("; ")) };
    page.paragraph("answer", &format!("{runs} runs, {finished} finished.{swept}"));
    page.paragraph(
        "rule",
        "Bands and bars: 5th to 95th percentile over the seeds. Lines, marks and numbers: median.",
    );
    let along = sweep.along();
    for (metric, (name, meaning)) in sweep.drawn.iter().filter_map(|k| Some((*k, sweep.metrics.get(*k)?))) {
        page.heading(name);
        match along {
            Some(axis) => page.figure(&sweep.fan(metric, axis, meaning), None),
            None => page.add(sweep.bars(metric, meaning)),
        }
        for map in sweep.heat_maps(metric, meaning) {
            page.add(map);
        }
    }
    sweep.medians(&mut page);
    page.finish()
}

impl Sweep {
    /// The numeric axis with the most values: fans go along it.
    fn along(&self) -> Option<usize> {
        self.numeric().into_iter().max_by_key(|axis| (self.axes[*axis].labels.len(), usize::MAX - axis))
    }

    /// Axes whose values are two numbers or more.
    fn numeric(&self) -> Vec<usize> {
        let is_numeric = |axis: &SweptAxis| {
            axis.labels.len() > 1 && axis.labels.iter().all(|l| l.parse::<f64>().is_ok_and(f64::is_finite))
        };
        (0..self.axes.len()).filter(|k| is_numeric(&self.axes[*k])).collect()
    }

    /// What tells a group from others, without these axes: `loss = 0.1, law = decentralised`.
    fn label(&self, group: &SweptGroup, without: &[usize]) -> String {
        let several = self.groups.iter().any(|other| other.experiment != group.experiment);
        let axes = self.axes.iter().zip(&group.labels).enumerate();
        let parts = axes
            .filter(|(k, (axis, _))| !without.contains(k) && axis.labels.len() > 1)
            .map(|(_, (axis, label))| format!("{} = {label}", axis.name));
        let parts: Vec<String> = several.then(|| group.experiment.clone()).into_iter().chain(parts).collect();
        if parts.is_empty() { group.experiment.clone() } else { parts.join(", ") }
    }

    /// The groups by what they share apart from these axes, in order.
    fn families(&self, without: &[usize]) -> Vec<(String, Vec<&SweptGroup>)> {
        let mut families: Vec<(String, Vec<&SweptGroup>)> = Vec::new();
        for group in &self.groups {
            let label = self.label(group, without);
            match families.iter_mut().find(|(known, _)| *known == label) {
                Some((_, members)) => members.push(group),
                None => families.push((label, vec![group])),
            }
        }
        families
    }

    fn fan(&self, metric: usize, axis: usize, meaning: &str) -> Figure {
        let mut figure = Figure {
            title: meaning.to_owned(),
            caption: "A line to each combination of what else was swept.".to_owned(),
            y_label: self.metrics.get(metric).map_or_else(String::new, |(name, _)| name.clone()),
            x_label: self.axes[axis].name.clone(),
            ..Figure::default()
        };
        for (label, members) in self.families(&[axis]) {
            let mut points: Vec<(f64, [f64; 3])> = members
                .iter()
                .filter_map(|group| {
                    let x = group.labels.get(axis)?.parse().ok()?;
                    Some((x, *group.percentiles.get(metric)?))
                        .filter(|(_, p)| p.iter().all(|v| v.is_finite()))
                })
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let curve = |k: usize| Curve::new(label.clone(), points.iter().map(|(x, p)| (*x, p[k])));
            figure.curves.push(curve(1));
            figure.bands.push((curve(0), curve(2)));
        }
        figure
    }

    /// A table of coloured medians over the two first numeric axes for everything else that was swept.
    fn heat_maps(&self, metric: usize, meaning: &str) -> Vec<Markup> {
        let [across, down] = match self.numeric().as_slice() {
            [a, b, ..] => [*a, *b],
            _ => return Vec::new(),
        };
        let median = |group: &SweptGroup| group.percentiles.get(metric).map_or(f64::NAN, |p| p[1]);
        let finite = || self.groups.iter().map(median).filter(|m| m.is_finite());
        let (low, high) =
            (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        // Medians that hardly differ are hardly coloured: the strongest colour is a difference that matters.
        let span = (high - low).max(FULL_COLOUR * low.abs().max(high.abs()));
        let share = |m: f64| if span > 0.0 { (m - low) / span } else { 0.0 };
        let [columns, rows] = [across, down].map(|k| &self.axes[k]);
        let cell = |members: &[&SweptGroup], column: &str, row: &str| {
            let at = |g: &&&SweptGroup| g.labels[across] == column && g.labels[down] == row;
            let m = members.iter().find(at).map_or(f64::NAN, |group| median(group));
            let colour = m.is_finite().then(|| {
                format!(
                    "background: color-mix(in srgb, var(--c0) {:.0}%, var(--page))",
                    STRONGEST_PERCENT * share(m)
                )
            });
            html! { td class="n" style=[colour] { (if m.is_finite() { three_digits(m) } else { "–".to_owned() }) } }
        };
        self.families(&[across, down])
            .iter()
            .map(|(label, members)| {
                html! {
                    div class="wide" {
                        table class="heat" {
                            caption { "Median of " (meaning) ": " (label) " (from " (three_digits(low)) " to " (three_digits(high)) ")" }
                            tr { td {} th class="n" colspan=(columns.labels.len()) { (columns.name) } }
                            tr {
                                th { (rows.name) }
                                @for column in &columns.labels { th class="n" scope="col" { (column) } }
                            }
                            @for row in &rows.labels {
                                tr {
                                    th class="n" scope="row" { (row) }
                                    @for column in &columns.labels { (cell(members, column, row)) }
                                }
                            }
                        }
                    }
                }
            })
            .collect()
    }

    /// A bar to each group, from zero on, beside its number.
    fn bars(&self, metric: usize, meaning: &str) -> Markup {
        let values = |group: &SweptGroup| group.percentiles.get(metric).copied().unwrap_or([f64::NAN; 3]);
        let largest = self.groups.iter().flat_map(values).filter(|v| v.is_finite()).fold(0.0, f64::max);
        let percent = |v: f64| if largest > 0.0 { 100.0 * (v / largest).clamp(0.0, 1.0) } else { 0.0 };
        html! {
            p class="caption" { (meaning) ". Bars from 0 to " (three_digits(largest)) "." }
            div class="wide" {
                table class="bars" {
                    @for group in &self.groups {
                        @let [low, median, high] = values(group);
                        tr {
                            th scope="row" { (self.label(group, &[])) }
                            @if median.is_finite() {
                                td class="bar-cell" {
                                    div class="track" aria-hidden="true" {
                                        i class="span" style=(format!("left: {:.1}%; width: {:.1}%", percent(low), percent(high) - percent(low))) {}
                                        i class="mark" style=(format!("left: {:.1}%", percent(median))) {}
                                    }
                                }
                                td class="n" { (three_digits(median)) }
                                td class="n" { (three_digits(low)) " to " (three_digits(high)) }
                            } @else {
                                td { "none" } td {} td {}
                            }
                        }
                    }
                }
            }
        }
    }

    fn medians(&self, page: &mut Document) {
        page.heading("All medians");
        let swept: Vec<usize> = (0..self.axes.len()).collect();
        let mut headings = vec!["experiment".to_owned()];
        headings.extend(swept.iter().map(|k| format!("#{}", self.axes[*k].name)));
        headings.extend(["#runs", "#finished", "otherwise"].map(str::to_owned));
        headings.extend(self.metrics.iter().map(|(name, _)| format!("#{name}")));
        let row = |group: &SweptGroup| {
            let mut cells = vec![text(&group.experiment)];
            cells.extend(group.labels.iter().map(|label| right(label)));
            cells.extend(group.runs.map(|count| right(&count.to_string())));
            cells.push(text(&group.otherwise));
            let known = |m: f64| if m.is_finite() { three_digits(m) } else { "–".to_owned() };
            cells.extend(group.percentiles.iter().map(|[_, median, _]| right(&known(*median))));
            cells
        };
        let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
        page.table(&headings, &self.groups.iter().map(row).collect::<Vec<_>>());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sweep(axes: &[(&str, &[&str])]) -> Sweep {
        let axes: Vec<SweptAxis> = axes
            .iter()
            .map(|(name, labels)| SweptAxis {
                name: (*name).to_owned(),
                labels: labels.iter().map(|l| (*l).to_owned()).collect(),
            })
            .collect();
        let mut combinations = vec![Vec::new()];
        for axis in &axes {
            combinations = combinations
                .iter()
                .flat_map(|c: &Vec<String>| {
                    axis.labels.iter().map(move |l| [c.as_slice(), std::slice::from_ref(l)].concat())
                })
                .collect();
        }
        let group = |(k, labels): (usize, Vec<String>)| SweptGroup {
            experiment: "e".to_owned(),
            labels,
            runs: [3, 3],
            otherwise: String::new(),
            percentiles: vec![[k as f64, k as f64 + 0.5, k as f64 + 1.0]],
        };
        Sweep {
            name: "s".to_owned(),
            groups: combinations.into_iter().enumerate().map(group).collect(),
            axes,
            metrics: vec![("error_deg".to_owned(), "an error [deg]".to_owned())],
            drawn: vec![0],
        }
    }

    #[test]
    fn a_fan_goes_along_the_longest_axis_and_names_the_other() {
        let sweep = sweep(&[("loss", &["0.0", "0.1"]), ("delay_s", &["0.2", "0.001", "0.05"])]);
        assert_eq!(sweep.along(), Some(1));
        let fan = sweep.fan(0, 1, "an error [deg]");
        assert_eq!(fan.x_label, "delay_s");
        let names: Vec<&str> = fan.curves.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["loss = 0.0", "loss = 0.1"]);
        assert_eq!(fan.curves[0].time_s, [0.001, 0.05, 0.2], "in order of the delay");
        assert_eq!(fan.curves[0].value, [1.5, 2.5, 0.5]);
        assert_eq!(fan.bands[1].0.value, [4.0, 5.0, 3.0]);
    }

    #[test]
    fn two_numbers_make_a_heat_map_whose_strongest_cell_is_the_largest() {
        let page = campaign_html(&sweep(&[("loss", &["0.0", "0.1"]), ("delay_s", &["0.001", "0.05"])]));
        assert_eq!(page.matches("<table class=\"heat\"").count(), 1);
        let strongest =
            page.split("<td class=\"n\" style=").filter(|cell| cell.contains("var(--c0) 45%")).count();
        assert_eq!(strongest, 1);
        assert!(page.contains("var(--c0) 45%, var(--page))\">3.50</td>"), "the last group");
    }

    #[test]
    fn what_has_no_order_is_a_bar_with_its_axis_named() {
        let page = campaign_html(&sweep(&[("law", &["a", "b"])]));
        assert!(page.contains("law = a") && page.contains("law = b") && !page.contains("class=\"heat\""));
        assert!(
            page.contains("left: 40.0%; width: 40.0%") || page.contains("left: 0.0%; width: 50.0%"),
            "from zero on"
        );
    }
}
