//! Before and after, in words and as tables.

use whorl_diagnosis::FittedParameter;
use whorl_report::three_digits;

use super::versions::{CORRECTION, Version, error, worst_gyro};
use super::writing::WORSE;
use crate::table::print;

/// A correction of more standard deviations than this is listed.
const TOLD_STDDEVS: f64 = 2.0;

pub fn answer(versions: &[Version]) -> Vec<String> {
    let mut answer = Vec::new();
    let Some(before) = versions.first() else { return answer };
    for version in versions.iter().filter(|v| !v.effects.is_empty()) {
        let mut text = format!("{}:", capitalised(&version.name));
        for (held_out, kind) in [(false, "training"), (true, "held-out")] {
            if let (Some(a), Some(b)) = (error(before, held_out), error(version, held_out)) {
                text.push_str(&format!(" {kind} error {a:.2} -> {b:.2} times the noise;"));
            }
        }
        let held_out = version.runs.iter().any(|r| r.held_out);
        if let Some((name, errors, floor)) = worst_gyro(versions, held_out) {
            let place = versions.iter().position(|v| std::ptr::eq(v, version)).unwrap_or(0);
            if let (Some(a), Some(b)) = (errors.first(), errors.get(place)) {
                text.push_str(&format!(
                    " {} {name} over 10 s {} -> {} deg/s RMS (noise {}).",
                    if held_out { "held-out" } else { "training" },
                    three_digits(*a),
                    three_digits(*b),
                    three_digits(floor)
                ));
            }
        }
        if text.ends_with(';') {
            text.pop();
            text.push('.');
        }
        answer.push(text);
        let base = versions.iter().find(|v| v.name == "base refitted");
        if let Some((a, b)) = base.and_then(|base| Some((error(base, held_out)?, error(version, held_out)?)))
            && b > a / WORSE
        {
            answer.push(format!(
                "Refitting inertia, centre of mass and actuators alone does as well ({a:.3} against {b:.3}): these data do not call for {}.",
                version.effects.join(" and ")
            ));
        }
    }
    if !before.runs.iter().any(|r| r.held_out) {
        answer.push(
            "No held-out run was given: whether the model predicts other runs better was not tested."
                .to_owned(),
        );
    }
    answer
}

fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |c| c.to_uppercase().chain(characters).collect())
}

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
                let absolute = v.runs.get(k).and_then(|r| r.comparison.absolute);
                absolute.map_or_else(|| "-".to_owned(), |a| format!("{:.3}", a.chi_squared_per_degree.sqrt()))
            }));
            row
        })
        .collect();
    println!(
        "Error over noise (root of chi-squared per degree of freedom, initial states fitted; 1 = noise)"
    );
    print(&headings, &rows);
}

pub fn print_parameters(version: &Version) {
    let Some(fit) = &version.fit else { return };
    println!("\nParameters {}", version.name);
    // Corrections of wheels and jets that the data do not ask for would only hide the others.
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
        println!(
            "  and {others} corrections of wheels and jets, each within {TOLD_STDDEVS} standard deviations of none"
        );
    }
}
