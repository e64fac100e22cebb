//! The page of `whorl adopt`.

use super::{ComparedRun, Facts, facts};
use crate::document::{Document, code, judged, significant, text};
use crate::figure::Figure;
use crate::series::Curve;

/// A parameter that a fit has changed.
#[derive(Debug, Clone, PartialEq)]
pub struct AdoptedParameter {
    /// Effect id, or what it belongs to.
    pub group: String,
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Before.
    pub before: f64,
    /// After.
    pub estimate: f64,
    /// Standard deviation.
    pub stddev: f64,
}

/// What the page shows: the same runs with the model before and after.
#[derive(Debug, Clone)]
pub struct AdoptionPage {
    /// The answer, one paragraph each.
    pub answer: Vec<String>,
    /// Name of each model version, `before` first.
    pub versions: Vec<String>,
    /// For each version, every run.
    pub runs: Vec<Vec<ComparedRun>>,
    /// What was fitted for the version that was adopted.
    pub parameters: Vec<AdoptedParameter>,
}

/// The page as one self-contained HTML document.
#[must_use]
pub fn adoption_html(adoption: &AdoptionPage, about: &Facts) -> String {
    let mut page = Document::new("What does the effect bring?");
    for sentence in &adoption.answer {
        page.paragraph("answer", sentence);
    }
    page.heading("Errors of the model versions");
    page.paragraph("rule", "Square root of chi-squared per degree of freedom, initial states fitted: 1 = nothing but noise. Held-out runs took part in no fit.");
    let versions: Vec<String> = adoption.versions.iter().map(|v| format!("#{v}")).collect();
    let mut headings = vec!["run", ""];
    headings.extend(versions.iter().map(String::as_str));
    let first = adoption.runs.first().map_or(&[][..], Vec::as_slice);
    let rows: Vec<Vec<String>> = first
        .iter()
        .enumerate()
        .map(|(k, run)| {
            let mut row =
                vec![text(&run.comparison.run), text(if run.held_out { "held out" } else { "training" })];
            row.extend(adoption.runs.iter().map(|version| {
                let value = version
                    .get(k)
                    .and_then(|r| r.comparison.absolute)
                    .map_or(f64::NAN, |a| a.chi_squared_per_degree.sqrt());
                judged(value, 3, value < 1.1)
            }));
            row
        })
        .collect();
    page.table(&headings, &rows);
    channel_table(&mut page, adoption);
    for (k, run) in first.iter().enumerate() {
        page.figure(&fall(adoption, k, &run.comparison.run), None);
    }
    page.heading("Parameters");
    let rows: Vec<Vec<String>> = adoption
        .parameters
        .iter()
        .map(|p| {
            vec![
                code(&p.group),
                code(&p.name),
                text(&p.unit),
                significant(p.before),
                significant(p.estimate),
                significant(p.stddev),
            ]
        })
        .collect();
    page.table(&["of", "parameter", "unit", "#before", "#after", "#standard deviation"], &rows);
    facts(&mut page, about);
    page.finish()
}

/// RMS errors at ten seconds (or the longest finite horizon), all channels.
fn channel_table(page: &mut Document, adoption: &AdoptionPage) {
    let first = adoption.runs.first().map_or(&[][..], Vec::as_slice);
    for (k, run) in first.iter().enumerate() {
        let Some(horizon_s) =
            run.comparison.channels.first().and_then(|c| c.horizons.iter().rev().find_map(|h| h.horizon_s))
        else {
            continue;
        };
        page.paragraph(
            "",
            &format!(
                "{}{}: RMS error of predictions over {horizon_s} s",
                run.comparison.run,
                if run.held_out { " (held out)" } else { "" }
            ),
        );
        let versions: Vec<String> = adoption.versions.iter().map(|v| format!("#{v}")).collect();
        let mut headings = vec!["channel", "unit", "#noise floor"];
        headings.extend(versions.iter().map(String::as_str));
        let rows: Vec<Vec<String>> = run
            .comparison
            .channels
            .iter()
            .map(|channel| {
                let (unit, factor) = channel.quantity.display();
                let mut row =
                    vec![text(&channel.name), text(unit), significant(channel.noise_floor * factor)];
                row.extend(adoption.runs.iter().map(|version| {
                    let channels = version.get(k).map_or(&[][..], |r| &r.comparison.channels);
                    let same = channels.iter().find(|c| c.name == channel.name);
                    let found = same.and_then(|c| c.horizons.iter().find(|h| h.horizon_s == Some(horizon_s)));
                    significant(found.map_or(f64::NAN, |h| h.rms * factor))
                }));
                row
            })
            .collect();
        page.table(&headings, &rows);
    }
}

/// Error over horizon of the gyro's worst axis, one curve for each version.
fn fall(adoption: &AdoptionPage, run: usize, name: &str) -> Figure {
    let curves = adoption.versions.iter().zip(&adoption.runs).filter_map(|(version, runs)| {
        let comparison = &runs.get(run)?.comparison;
        let gyro = comparison.channels.iter().filter(|c| c.name.starts_with("gyro"));
        let worst = |horizon_s: Option<f64>| {
            let ratios = gyro.clone().flat_map(|c| &c.horizons).filter(|h| h.horizon_s == horizon_s);
            ratios.map(|h| h.ratio).fold(f64::NAN, f64::max)
        };
        let horizons = comparison.channels.first()?.horizons.iter().map(|h| h.horizon_s);
        let points = horizons.map(|h| (h.unwrap_or(comparison.duration_s), worst(h)));
        Some(Curve::new(version.as_str(), points.collect::<Vec<_>>()))
    });
    Figure {
        title: format!("{name}: error over horizon"),
        caption: "Largest ratio of a gyro axis' RMS error to its noise floor.".to_owned(),
        x_label: "horizon [s]".to_owned(),
        y_label: "RMS / noise floor".to_owned(),
        curves: curves.collect(),
        log: true,
        log_x: true,
        ..Figure::default()
    }
}
