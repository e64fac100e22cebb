//! The page of `whorl compare`.

use maud::Markup;
use whorl_explain::ComparedRun;
use whorl_validation::Comparison;
use whorl_validation::comparison::{Channel, ChannelErrors, HorizonError, Overlay, PREDICTION_RULE, ahead};

use super::{Facts, facts};
use crate::document::{Document, judged, number, significant, text};
use crate::figure::Figure;
use crate::series::{Curve, GrowingCurve};
use crate::timeline::Timeline;

/// Largest ratio that is shown as good, unless its own band is wider.
const GOOD_RATIO: f64 = 1.1;

/// Half the width of bands, in standard deviations.
const BAND: f64 = 3.0;

/// Name of the run, and whether it was held out.
pub(super) fn title(run: &ComparedRun) -> String {
    format!("{}{}", run.comparison.title(), if run.held_out { " (held out)" } else { "" })
}

/// The page as one self-contained HTML document; `of_models` says first which models these are, where they are not
/// the given ones.
#[must_use]
pub fn comparison_html(runs: &[ComparedRun], of_models: &[String], about: &Facts) -> String {
    let mut page = Document::new("How far off is the model?");
    for of_model in of_models {
        page.paragraph("answer", of_model);
    }
    for run in runs {
        // Together: the second does not say of which run it is.
        page.paragraph("answer", &run.comparison.answer());
        page.paragraph("answer", &run.comparison.said_of_innovations());
    }
    page.heading("Prediction errors");
    page.paragraph("rule", &format!("Predictions: {PREDICTION_RULE}."));
    page.paragraph(
        "rule",
        "RMS of measured less predicted, so long ahead. Deviation: that which the model predicts for these errors. Ratio: of each error \
         over its predicted deviation, RMS. Noise: of a reading, as the run shows it; stated: as the platform's file does. Fit: 100 % = perfect, 0 % = \
         no better than the mean; it is left out where a channel does not move beyond its noise. Held-out runs took part in no fit.",
    );
    for run in runs {
        error_table(&mut page, run);
    }
    // The time of one run is shared by its figures; several runs have nothing in common but its zero.
    if let [run] = runs {
        page.set_timeline(Timeline::plain((0.0, run.comparison.duration_s)));
    }
    for run in runs {
        run_section(&mut page, run);
    }
    facts(&mut page, about);
    page.finish()
}

fn horizon_name(horizon_s: Option<f64>) -> String {
    horizon_s.map_or_else(|| "run".to_owned(), |h| format!("{} s", ahead(h)))
}

/// What tables call the columns of a horizon, numbers all: how large the errors are, which deviation the model predicts for them, errors over
/// their predicted deviations, and the fit.
#[must_use]
pub fn horizon_columns(of: &HorizonError) -> [String; 4] {
    let over = horizon_name(of.horizon_s);
    [format!("#{over}: RMS"), "#deviation".to_owned(), "#ratio".to_owned(), "#fit %".to_owned()]
}

fn error_table(page: &mut Document, run: &ComparedRun) {
    let Some(first) = run.comparison.channels.first() else { return };
    page.paragraph("", &title(run));
    let mut headings =
        vec!["channel".to_owned(), "unit".to_owned(), "#noise".to_owned(), "#stated".to_owned()];
    for h in &first.horizons {
        headings.extend(horizon_columns(h));
    }
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    let rows: Vec<Vec<Markup>> = run.comparison.channels.iter().map(error_row).collect();
    page.table(&headings, &rows);
}

fn error_row(channel: &ChannelErrors) -> Vec<Markup> {
    let (unit, factor) = channel.quantity.shown_unit();
    let mut row = vec![
        text(&channel.name),
        text(unit),
        significant(channel.noise_floor * factor),
        significant(channel.stated_noise * factor),
    ];
    for h in &channel.horizons {
        row.push(significant(h.rms * factor));
        row.push(significant(h.predicted_stddev * factor));
        row.push(judged(h.ratio, 2, h.ratio < GOOD_RATIO.max(h.band_99.1)));
        row.push(number(h.fit_percent.unwrap_or(f64::NAN), 1));
    }
    row
}

fn run_section(page: &mut Document, run: &ComparedRun) {
    let comparison = &run.comparison;
    page.heading(&title(run));
    let absolute = &comparison.absolute;
    page.paragraph(
        "",
        &format!(
            "The whole run against noise alone: chi-squared per degree of freedom {}, 99 % band {:.3} to {:.3} ({} degrees).",
            whorl_math::three_digits(absolute.chi_squared_per_degree),
            absolute.band_99.0,
            absolute.band_99.1,
            absolute.degrees
        ),
    );
    if comparison.unexplained.is_some() {
        page.paragraph("", &format!("Unexplained: {}.", comparison.unexplained));
    }
    page.list(&comparison.remarks);
    page.figure(&staircase(comparison), None);
    let span = Some((0.0, comparison.duration_s));
    for channel in &comparison.channels {
        for figure in overlay_figures(channel) {
            page.figure(&figure, span);
        }
    }
    whiteness_table(page, comparison);
}

/// Ratio to the predicted deviation over the horizon.
pub(super) fn staircase(comparison: &Comparison) -> Figure {
    let curve = |channel: &ChannelErrors| {
        let points = channel.horizons.iter().map(|h| (h.horizon_s.unwrap_or(comparison.duration_s), h.ratio));
        Curve::new(channel.name.as_str(), points)
    };
    Figure {
        title: "Error over horizon".to_owned(),
        caption: "Errors over their predicted deviations. A curve that rises is a model error that accumulates; a curve at one is noise."
            .to_owned(),
        x_label: "horizon [s]".to_owned(),
        y_label: "error / predicted deviation".to_owned(),
        curves: comparison.channels.iter().map(curve).collect(),
        log: true,
        log_x: true,
        ..Figure::default()
    }
}

pub(super) fn overlay_figures(channel: &ChannelErrors) -> Vec<Figure> {
    let Some(overlay) = &channel.overlay else { return Vec::new() };
    let (unit, factor) = channel.quantity.shown_unit();
    let scaled =
        |curve: &GrowingCurve| -> Vec<(f64, f64)> { curve.points().map(|(t, v)| (t, v * factor)).collect() };
    let stddev = scaled(&overlay.stddev);
    let edge = |sign: f64| Curve::new("predicted", stddev.iter().map(|(t, s)| (*t, sign * BAND * s)));
    let band = (edge(-1.0), edge(1.0));
    let name = channel.name.replace('_', " ");
    let horizon = horizon_name(Some(overlay.horizon_s));
    let mut figures = Vec::new();
    if channel.quantity != Channel::Accelerometer {
        figures.push(measured_and_predicted(channel, overlay, ""));
    }
    figures.push(Figure {
        title: format!("{name}: error of predictions over {horizon}"),
        caption: "Measured less predicted. Band: three standard deviations that the model predicts."
            .to_owned(),
        y_label: format!("error [{unit}]"),
        curves: vec![Curve::new(format!("{name} error"), scaled(&overlay.error))],
        bands: vec![band],
        ..Figure::default()
    });
    figures
}

/// A channel as it was measured and as it was predicted, with the band of the predictions; `of_what` ends the title.
pub(super) fn measured_and_predicted(channel: &ChannelErrors, overlay: &Overlay, of_what: &str) -> Figure {
    let (unit, factor) = channel.quantity.shown_unit();
    let curve = |name: &str, points: &mut dyn Iterator<Item = (f64, f64)>| {
        Curve::new(format!("{} {name}", channel.name.replace('_', " ")), points.collect::<Vec<_>>())
    };
    let scaled = |(t, value): (f64, f64)| (t, value * factor);
    let edge = |sign: f64| {
        let points = overlay.predicted.points().zip(overlay.stddev.points());
        curve("predicted", &mut points.map(|((t, y), (_, s))| scaled((t, y + sign * BAND * s))))
    };
    let name = channel.name.replace('_', " ");
    // A band has the colour of the curve of the same position; what was measured has none.
    let no_band = || Curve::new("", Vec::<(f64, f64)>::new());
    let predicted = curve("predicted", &mut overlay.predicted.points().map(scaled));
    let measured = curve("measured", &mut overlay.measured.points().map(scaled));
    Figure {
        title: format!("{name}: measured and predicted{of_what}"),
        caption: format!(
            "Predictions of {}, one after the other. Band: three standard deviations that the model predicts.",
            horizon_name(Some(overlay.horizon_s))
        ),
        y_label: format!("{name} [{unit}]"),
        curves: vec![measured, predicted],
        bands: vec![(no_band(), no_band()), (edge(-1.0), edge(1.0))],
        ..Figure::default()
    }
}

fn whiteness_table(page: &mut Document, comparison: &Comparison) {
    if comparison.whiteness.is_empty() {
        return;
    }
    page.paragraph(
        "rule",
        "Is anything left? Innovations: each reading less its prediction from everything before it, over its deviation. White ones hold nothing that a model could explain. \
         Ljung-Box: first 25 autocorrelations.",
    );
    let rows: Vec<Vec<Markup>> = comparison
        .whiteness
        .iter()
        .map(|w| {
            vec![
                text(&w.channel),
                judged(w.rms, 3, w.rms < GOOD_RATIO),
                judged(w.ljung_box.statistic, 1, w.ljung_box.is_white()),
                number(w.ljung_box.limit_99, 1),
                number(w.correlated_over_s, 2),
            ]
        })
        .collect();
    let headings = ["channel", "#RMS", "#Ljung-Box Q", "#99 % limit", "#correlated over [s]"];
    page.table(&headings, &rows);
}
