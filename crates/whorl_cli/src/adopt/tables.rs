//! Before and after as tables.

use whorl_explain::Version;
use whorl_explain::adopt::CORRECTION;
use whorl_identification::FittedParameter;
use whorl_math::three_digits;

use crate::output::say;
use crate::table::print;

/// A correction is listed if it exceeds this many standard deviations.
const TOLD_STDDEVS: f64 = 2.0;

pub fn print_versions(versions: &[Version]) {
    let mut headings = vec!["run".to_owned(), String::new()];
    headings.extend(versions.iter().map(|v| format!("#{}", v.name)));
    let Some(first) = versions.first() else { return };
    let rows: Vec<Vec<String>> = first
        .runs
        .iter()
        .enumerate()
        .map(|(k, run)| {
            let kind = if run.held_out { "held out" } else { "training" };
            let mut row = vec![run.comparison.run.clone(), kind.to_owned()];
            row.extend(versions.iter().map(|v| {
                let error = v.runs.get(k).and_then(|r| r.comparison.prediction_error());
                error.map_or_else(|| "-".to_owned(), |error| format!("{error:.3}"))
            }));
            row
        })
        .collect();
    say!(
        "Prediction error, times the noise (errors of predictions of 10 s over their predicted deviations; 1 = noise)"
    );
    print(&headings, &rows);
}

pub fn print_parameters(version: &Version) {
    let Some(fit) = &version.fit else { return };
    say!("\nParameters {}", version.name);
    // Insignificant corrections of wheels and jets would only hide the others.
    let is_told = |p: &&FittedParameter| {
        !p.name.ends_with(CORRECTION) || (p.estimate - p.before).abs() > TOLD_STDDEVS * p.stddev
    };
    let rows: Vec<Vec<String>> = fit
        .estimates
        .iter()
        .filter(is_told)
        .map(|p| {
            let bound = if p.at_bound { "at its bound" } else { "" };
            vec![
                p.group.clone(),
                p.name.clone(),
                p.unit.clone(),
                three_digits(p.before),
                three_digits(p.estimate),
                three_digits(p.stddev),
                bound.to_owned(),
            ]
        })
        .collect();
    let headings = ["of", "parameter", "unit", "#before", "#after", "#+-", ""].map(str::to_owned);
    print(&headings, &rows);
    let others = fit.estimates.len() - rows.len();
    if others > 0 {
        say!(
            "  and {others} corrections of wheels and jets, each within {TOLD_STDDEVS} standard deviations of zero"
        );
    }
}
