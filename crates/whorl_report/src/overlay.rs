//! Runs on one page: what differs, and every figure with all of them.

use maud::Markup;

use crate::data::RunData;
use crate::document::{Document, code, number, text};
use crate::figure::{Figure, STYLES};
use crate::figures::{link_figure, pair_figures, platform_figures};
use crate::metrics::pairs;
use crate::series::Curve;
use crate::timeline::Timeline;

/// Stretches that a hold is divided into to estimate the noise of its mean square. Twenty are longer than the errors'
/// correlation time in holds of half a minute, and enough to estimate a variance.
const BATCHES: usize = 20;
/// 99 % of Student's t with 2 * (20 - 1) degrees of freedom, two-sided.
const T_99: f64 = 2.71;

/// How many runs a page shows at most: as many as there are styles of lines.
pub const MOST_RUNS: usize = STYLES;
/// Names of these styles.
const STYLE_NAMES: [&str; STYLES] = ["solid", "dashed", "dotted", "dashes and dots"];

/// The relative pointing error of one pair in the first run and in another.
#[derive(Debug, Clone, PartialEq)]
pub struct PairDifference {
    /// Follower and leader.
    pub pair: String,
    /// The other run, by its place.
    pub other: usize,
    /// RMS in hold of both runs, and its standard error from the run's own noise \[rad\].
    pub rms_rad: [(f64, f64); 2],
    /// Whether the difference is beyond the noise of both runs (99 %).
    pub significant: bool,
}

/// A parameter that differs: key, nodes, value in each run.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterDifference {
    /// Its key.
    pub key: String,
    /// Nodes that read it.
    pub nodes: String,
    /// Its value in each run, as in a parameter file; a dash: not there.
    pub values: Vec<String>,
}

/// Compares the relative pointing errors in hold of every pair of the first run with those of the other runs that have it.
#[must_use]
pub fn pair_differences(runs: &[&RunData]) -> Vec<PairDifference> {
    let Some((first, others)) = runs.split_first() else { return Vec::new() };
    let rms = |run: &RunData, pair: &(String, String)| rms_with_error(&run.pairs.get(pair)?.held_rad);
    let difference = |pair: &(String, String), other: usize, run: &RunData| {
        let rms_rad = [rms(first, pair)?, rms(run, pair)?];
        let [(a, sa), (b, sb)] = rms_rad;
        let significant = (a - b).abs() > T_99 * sa.hypot(sb);
        let (follower, leader) = pair;
        Some(PairDifference { pair: format!("{follower} to {leader}"), other, rms_rad, significant })
    };
    pairs(first)
        .iter()
        .flat_map(|pair| {
            (1..).zip(others).filter_map(|(other, run)| difference(pair, other, run)).collect::<Vec<_>>()
        })
        .collect()
}

/// Root mean square and its standard error, which is that of the means of batches: neighbouring samples are correlated, batches
/// that are much longer than the correlation are not. `None` with too few samples.
fn rms_with_error(samples: &[f64]) -> Option<(f64, f64)> {
    let length = samples.len() / BATCHES;
    if length == 0 {
        return None;
    }
    let mean_square = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64;
    let batches: Vec<f64> = samples.chunks_exact(length).take(BATCHES).map(mean_square).collect();
    let mean = batches.iter().sum::<f64>() / BATCHES as f64;
    let variance = batches.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (BATCHES - 1) as f64;
    let rms = mean.sqrt();
    // d(rms) = d(mean square) / (2 rms)
    Some((rms, if rms > 0.0 { (variance / BATCHES as f64).sqrt() / (2.0 * rms) } else { 0.0 }))
}

/// The page: answers, parameters that differ, and every figure of the first run with the same of the others; at most
/// [`MOST_RUNS`].
#[must_use]
pub fn overlay_html(
    names: &[String],
    answers: &[String],
    parameters: &[ParameterDifference],
    runs: &[&RunData],
) -> String {
    let mut page = Document::new(&names.join(", "));
    for answer in answers {
        page.paragraph("answer", answer);
    }
    errors_in_hold(&mut page, names, &pair_differences(runs));
    page.heading("Parameters that differ");
    if parameters.is_empty() {
        page.paragraph("", "None.");
    } else {
        let row = |p: &ParameterDifference| -> Vec<Markup> {
            let values = p.values.iter().map(|value| code(value));
            [code(&p.key), text(&p.nodes)].into_iter().chain(values).collect()
        };
        let rows: Vec<Vec<Markup>> = parameters.iter().map(row).collect();
        let headings: Vec<&str> =
            ["parameter", "nodes"].into_iter().chain(names.iter().map(String::as_str)).collect();
        page.table(&headings, &rows);
    }
    let span = (0.0, runs.iter().map(|run| run.duration_s).fold(0.0, f64::max));
    page.set_timeline(Timeline::plain(span));
    let mut each = runs.iter().map(|run| sections(run));
    let first = each.next().unwrap_or_default();
    let others: Vec<_> = each.collect();
    for (section, figures) in first {
        page.heading(&section);
        for figure in figures {
            let same = |sections: &Vec<(String, Vec<Figure>)>| {
                let (_, figures) = sections.iter().find(|(s, _)| *s == section)?;
                figures.iter().find(|other| other.title == figure.title).cloned()
            };
            let partners: Vec<Option<Figure>> = others.iter().map(same).collect();
            if partners.iter().any(Option::is_some) {
                page.figure(&together(figure, &partners, names), Some(span));
            }
        }
    }
    page.finish()
}

fn errors_in_hold(page: &mut Document, names: &[String], differences: &[PairDifference]) {
    page.heading("Relative pointing error in hold");
    page.paragraph(
        "rule",
        "RMS with its standard error from the noise within the run. Two runs with other seeds differ by more: constant errors, such as \
         a sensor's bias, are drawn anew for each.",
    );
    let name = |k: usize| names.get(k).map_or("", String::as_str);
    let row = |d: &PairDifference| {
        let mut cells = vec![text(&d.pair), text(name(d.other))];
        for rad in d.rms_rad.iter().flat_map(|(rms, error)| [rms, error]) {
            cells.push(number(whorl_math::deg_from_rad(*rad), 4));
        }
        cells.push(text(if d.significant { "yes" } else { "no" }));
        cells
    };
    let rows: Vec<Vec<Markup>> = differences.iter().map(row).collect();
    let first = format!("#{} [deg]", name(0));
    page.table(
        &["pair", "other run", &first, "#+-", "#other run [deg]", "#+-", "differ beyond noise"],
        &rows,
    );
}

/// The figures of a run by section.
fn sections(run: &RunData) -> Vec<(String, Vec<Figure>)> {
    let mut formation: Vec<Figure> = Vec::new();
    for pair in pairs(run) {
        let Some(errors) = run.pairs.get(&pair) else { continue };
        formation.extend(pair_figures(&pair.0, &pair.1, errors, None));
    }
    formation.push(link_figure(run, None));
    formation.retain(|f| !f.is_empty());
    let platform = |(name, data): (&String, _)| (format!("Platform {name}"), platform_figures(data, None));
    std::iter::once(("Formation".to_owned(), formation)).chain(run.platforms.iter().map(platform)).collect()
}

/// The solid curves of a figure, with those of the same figure of the other runs in the style of each run and the colour of their
/// partner.
fn together(mut figure: Figure, others: &[Option<Figure>], names: &[String]) -> Figure {
    let curves = std::mem::take(&mut figure.curves);
    let of_run = |k: usize| -> Vec<Curve> {
        let Some(run) = names.get(k) else { return Vec::new() };
        let named = |curve: &Curve| Curve { name: format!("{}, {run}", curve.name), ..curve.clone() };
        let other = k.checked_sub(1).map(|k| others.get(k).and_then(Option::as_ref));
        let partner = |curve: &Curve| match other {
            None => named(curve),
            Some(other) => {
                let found = other.and_then(|o| o.curves.iter().find(|c| c.name == curve.name));
                found.map_or_else(|| Curve::new(curve.name.clone(), []), named)
            }
        };
        curves.iter().map(partner).collect()
    };
    [figure.curves, figure.dashed, figure.dotted, figure.dash_dotted] = std::array::from_fn(of_run);
    figure.bands.clear();
    figure.band_of_all = None;
    let each = STYLE_NAMES.iter().zip(names).map(|(style, name)| format!("{name} {style}"));
    figure.caption = format!("Lines: {}.", each.collect::<Vec<_>>().join(", "));
    figure
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;

    /// A first-order autoregressive series of unit variance: its samples are correlated over ten samples.
    fn correlated(seed: u128, n: usize) -> Vec<f64> {
        let mut random = Pcg64::new(seed, 1);
        let (memory, normal) = ((-0.1_f64).exp(), Normal::new(0.0, 1.0).unwrap());
        let mut x = normal.sample(&mut random);
        (0..n)
            .map(|_| {
                x = memory * x + (1.0 - memory * memory).sqrt() * normal.sample(&mut random);
                x
            })
            .collect()
    }

    #[test]
    fn the_error_of_an_rms_is_right_for_correlated_samples() {
        // The spread of many RMS values, against what each series says of its own.
        let each: Vec<(f64, f64)> = (0..400).map(|s| rms_with_error(&correlated(s, 6000)).unwrap()).collect();
        let mean = each.iter().map(|(r, _)| r).sum::<f64>() / 400.0;
        let spread = (each.iter().map(|(r, _)| (r - mean).powi(2)).sum::<f64>() / 399.0).sqrt();
        let claimed = each.iter().map(|(_, e)| e).sum::<f64>() / 400.0;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
        assert!((claimed / spread - 1.0).abs() < 0.15, "{claimed} claimed, {spread} found");
    }

    #[test]
    fn every_run_has_its_style_and_every_curve_its_partners_colour() {
        let figure = |names: &[&str], value: f64| Figure {
            title: "F".to_owned(),
            curves: names.iter().map(|n| Curve::new(*n, [(0.0, value)])).collect(),
            ..Figure::default()
        };
        let names = ["a", "b", "c"].map(str::to_owned);
        let others = [Some(figure(&["y", "x"], 2.0)), Some(figure(&["y"], 3.0))];
        let drawn = together(figure(&["x", "y"], 1.0), &others, &names);
        let shown = |curves: &[Curve]| -> Vec<(String, Vec<f64>)> {
            curves.iter().map(|c| (c.name.clone(), c.value.clone())).collect()
        };
        let of = |name: &str, value: &[f64]| (name.to_owned(), value.to_vec());
        assert_eq!(shown(&drawn.curves), [of("x, a", &[1.0]), of("y, a", &[1.0])]);
        assert_eq!(shown(&drawn.dashed), [of("x, b", &[2.0]), of("y, b", &[2.0])]);
        assert_eq!(shown(&drawn.dotted), [of("x", &[]), of("y, c", &[3.0])], "run c has no x");
        assert!(drawn.dash_dotted.is_empty());
        assert_eq!(drawn.caption, "Lines: a solid, b dashed, c dotted.");
    }

    #[test]
    fn few_samples_give_no_answer() {
        assert_eq!(rms_with_error(&[1.0; 19]), None);
        assert_eq!(rms_with_error(&[2.0; 40]), Some((2.0, 0.0)));
    }
}
