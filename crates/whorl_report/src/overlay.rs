//! Two runs on one page: what differs, and every figure with both of them.

use maud::Markup;

use crate::data::RunData;
use crate::document::{Document, code, number, text};
use crate::figure::Figure;
use crate::figures::{link_figure, pair_figures, platform_figures};
use crate::metrics::pairs;
use crate::timeline::Timeline;

/// Stretches that a hold is divided into to estimate the noise of its mean square. Twenty are longer than the errors'
/// correlation time in holds of half a minute, and enough to estimate a variance.
const BATCHES: usize = 20;
/// 99 % of Student's t with 2 * (20 - 1) degrees of freedom, two-sided.
const T_99: f64 = 2.71;

/// The relative pointing error of one pair in both runs.
#[derive(Debug, Clone, PartialEq)]
pub struct PairDifference {
    /// Follower and leader.
    pub pair: String,
    /// RMS in hold of each run, and its standard error from the run's own noise \[rad\].
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
    pub values: [String; 2],
}

/// Compares the relative pointing errors in hold of every pair that both runs have.
#[must_use]
pub fn pair_differences(runs: [&RunData; 2]) -> Vec<PairDifference> {
    let other = pairs(runs[1]);
    pairs(runs[0])
        .into_iter()
        .filter(|pair| other.contains(pair))
        .filter_map(|pair| {
            let rms = |run: &RunData| rms_with_error(&run.pairs.get(&pair)?.held_rad);
            let rms_rad = [rms(runs[0])?, rms(runs[1])?];
            let [(a, sa), (b, sb)] = rms_rad;
            let significant = (a - b).abs() > T_99 * sa.hypot(sb);
            let (follower, leader) = pair;
            Some(PairDifference { pair: format!("{follower} to {leader}"), rms_rad, significant })
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

/// The page: answers, parameters that differ, and every figure that both runs have; solid is the first run.
#[must_use]
pub fn overlay_html(
    names: [&str; 2],
    answers: &[String],
    parameters: &[ParameterDifference],
    runs: [&RunData; 2],
) -> String {
    let mut page = Document::new(&format!("{} and {}", names[0], names[1]));
    for answer in answers {
        page.paragraph("answer", answer);
    }
    page.heading("Parameters that differ");
    if parameters.is_empty() {
        page.paragraph("", "None.");
    } else {
        let row = |p: &ParameterDifference| {
            vec![code(&p.key), text(&p.nodes), code(&p.values[0]), code(&p.values[1])]
        };
        let rows: Vec<Vec<Markup>> = parameters.iter().map(row).collect();
        page.table(&["parameter", "nodes", names[0], names[1]], &rows);
    }
    page.heading("Relative pointing error in hold");
    page.paragraph(
        "rule",
        "RMS with its standard error from the noise within the run. Two runs with other seeds differ by more: constant errors, such as \
         a sensor's bias, are drawn anew for each.",
    );
    let degrees = whorl_math::deg_from_rad;
    let row = |d: &PairDifference| {
        let mut cells = vec![text(&d.pair)];
        for (rms, error) in d.rms_rad {
            cells.push(number(degrees(rms), 4));
            cells.push(number(degrees(error), 4));
        }
        cells.push(text(if d.significant { "yes" } else { "no" }));
        cells
    };
    let rows: Vec<Vec<Markup>> = pair_differences(runs).iter().map(row).collect();
    let [a, b] = names.map(|name| format!("#{name} [deg]"));
    page.table(&["pair", &a, "#+-", &b, "#+-", "differ beyond noise"], &rows);
    let span = (0.0, runs[0].duration_s.max(runs[1].duration_s));
    page.set_timeline(Timeline::plain(span));
    for (section, figures) in sections(runs[0]) {
        let others =
            sections(runs[1]).into_iter().find(|(s, _)| *s == section).map_or_else(Vec::new, |(_, f)| f);
        page.heading(&section);
        for figure in figures {
            if let Some(other) = others.iter().find(|o| o.title == figure.title) {
                page.figure(&both(figure, other, names), Some(span));
            }
        }
    }
    page.finish()
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

/// The solid curves of both: those of the second run dashed, each in the colour of its partner.
fn both(mut figure: Figure, other: &Figure, names: [&str; 2]) -> Figure {
    let partner = |name: &str| other.curves.iter().find(|c| c.name == name).cloned().unwrap_or_default();
    figure.dashed = figure.curves.iter().map(|c| partner(&c.name)).collect();
    for (curves, run) in [(&mut figure.curves, names[0]), (&mut figure.dashed, names[1])] {
        curves.iter_mut().for_each(|c| c.name = format!("{}, {run}", c.name));
    }
    figure.bands.clear();
    figure.caption = format!("Solid: {}; dashed: {}.", names[0], names[1]);
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
    fn few_samples_give_no_answer() {
        assert_eq!(rms_with_error(&[1.0; 19]), None);
        assert_eq!(rms_with_error(&[2.0; 40]), Some((2.0, 0.0)));
    }
}
