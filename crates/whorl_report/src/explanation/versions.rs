//! Versions of a model side by side, as shown by `whorl diagnose` and `whorl adopt`.

use maud::Markup;
use whorl_explain::Version;

use super::comparison::title;
use crate::document::{Document, judged, significant, text};
use crate::figure::Figure;
use crate::series::Curve;

/// Prediction errors of every version: by run, over all runs, by channel and by horizon.
pub(super) fn versions(page: &mut Document, versions: &[Version]) {
    page.heading("Prediction error of the versions of the model");
    page.paragraph(
        "rule",
        "In times the noise: all channels predicted over stretches of 10 s, each error over the deviation that the model predicts for it; \
         1 = nothing but noise. Held-out runs took part in no fit.",
    );
    let names: Vec<String> = versions.iter().map(|v| format!("#{}", v.name)).collect();
    let mut headings = vec!["run", ""];
    headings.extend(names.iter().map(String::as_str));
    let cell = |value: Option<f64>| {
        let value = value.unwrap_or(f64::NAN);
        judged(value, 3, value < 1.1)
    };
    let first = versions.first().map_or(&[][..], |v| &v.runs);
    let mut rows: Vec<Vec<Markup>> = first
        .iter()
        .enumerate()
        .map(|(k, run)| {
            let mut row =
                vec![text(&run.comparison.run), text(if run.held_out { "held out" } else { "training" })];
            let of = |v: &Version| v.runs.get(k).and_then(|r| r.comparison.prediction_error());
            row.extend(versions.iter().map(|v| cell(of(v))));
            row
        })
        .collect();
    for (held_out, kind) in [(false, "training"), (true, "held out")] {
        if first.iter().filter(|run| run.held_out == held_out).count() > 1 {
            let mut row = vec![text("all"), text(kind)];
            row.extend(versions.iter().map(|v| cell(v.prediction_error(held_out))));
            rows.push(row);
        }
    }
    page.table(&headings, &rows);
    channel_table(page, versions);
    for (k, run) in first.iter().enumerate() {
        page.figure(&over_horizon(versions, k, &run.comparison.run), None);
    }
}

/// RMS errors at ten seconds (or the longest finite horizon), all channels.
fn channel_table(page: &mut Document, versions: &[Version]) {
    let first = versions.first().map_or(&[][..], |v| &v.runs);
    for (k, run) in first.iter().enumerate() {
        let Some(horizon_s) =
            run.comparison.channels.first().and_then(|c| c.horizons.iter().rev().find_map(|h| h.horizon_s))
        else {
            continue;
        };
        page.paragraph("", &format!("{}: RMS error of predictions {horizon_s} s ahead, and the deviation that the last version predicts for it", title(run)));
        let names: Vec<String> = versions.iter().map(|v| format!("#{}", v.name)).collect();
        let mut headings = vec!["channel", "unit"];
        headings.extend(names.iter().map(String::as_str));
        headings.push("#deviation");
        let rows: Vec<Vec<Markup>> = run
            .comparison
            .channels
            .iter()
            .map(|channel| {
                let (unit, factor) = channel.quantity.shown_unit();
                let of = |version: &Version| {
                    let channels = version.runs.get(k).map_or(&[][..], |r| &r.comparison.channels);
                    let same = channels.iter().find(|c| c.name == channel.name)?;
                    same.horizons.iter().find(|h| h.horizon_s == Some(horizon_s)).copied()
                };
                let scaled = |value: Option<f64>| significant(value.unwrap_or(f64::NAN) * factor);
                let mut row = vec![text(&channel.name), text(unit)];
                row.extend(versions.iter().map(|version| scaled(of(version).map(|h| h.rms))));
                row.push(scaled(versions.last().and_then(of).map(|h| h.predicted_stddev)));
                row
            })
            .collect();
        page.table(&headings, &rows);
    }
}

/// Error over horizon of the gyro's worst axis, one curve for each version.
pub(super) fn over_horizon(versions: &[Version], run: usize, name: &str) -> Figure {
    let curves = versions.iter().filter_map(|version| {
        let comparison = &version.runs.get(run)?.comparison;
        let gyro = comparison.channels.iter().filter(|c| c.name.starts_with("gyro"));
        let worst = |horizon_s: Option<f64>| {
            let ratios = gyro.clone().flat_map(|c| &c.horizons).filter(|h| h.horizon_s == horizon_s);
            ratios.map(|h| h.ratio).fold(f64::NAN, f64::max)
        };
        let horizons = comparison.channels.first()?.horizons.iter().map(|h| h.horizon_s);
        let points = horizons.map(|h| (h.unwrap_or(comparison.duration_s), worst(h)));
        Some(Curve::new(version.name.as_str(), points.collect::<Vec<_>>()))
    });
    Figure {
        title: format!("{name}: error over horizon"),
        caption: "Largest ratio of a gyro axis' errors to their predicted deviations.".to_owned(),
        x_label: "horizon [s]".to_owned(),
        y_label: "error / predicted deviation".to_owned(),
        curves: curves.collect(),
        log: true,
        log_x: true,
        ..Figure::default()
    }
}
