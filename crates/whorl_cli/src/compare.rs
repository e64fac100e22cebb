//! `whorl compare`: how far a model is from recorded runs.

use whorl_commands::compare::{as_json, refitted};
use whorl_explain::{ComparedRun, compare, prediction_error};
use whorl_math::three_digits;
use whorl_validation::Comparison;
use whorl_validation::comparison::{PREDICTION_RULE, ahead};

use crate::explain::ExplainArguments;
use crate::output::say;
use crate::progress;
use crate::table::print;

/// Arguments of `whorl compare`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
    /// Refits the platform's own parameters within their priors first, to all runs but held-out ones: what is then left
    /// is what the model lacks
    #[arg(long)]
    refit: bool,
}

/// Carries out `whorl compare`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let (compared, given) = if arguments.refit {
        let (given, refitted) =
            progress::watched("refitting and comparing", |say| refitted(&runs.case(), say))?;
        (refitted, Some(given))
    } else {
        (progress::watched("comparing the runs", |say| compare(&runs.case(), say))?, None)
    };
    let of_model = given.as_ref().map(|given| said_of_refit(given, &compared));
    if let Some(of_model) = &of_model {
        say!("{of_model}");
    }
    for run in &compared {
        say!("{}{}", run.comparison.answer(), if run.held_out { " (Held out: never fitted.)" } else { "" });
        say!("  {}", run.comparison.said_of_innovations());
        for finding in run.comparison.findings() {
            say!("  {finding}");
        }
    }
    for (held_out, kind) in [(false, ""), (true, "held-out ")] {
        let count = compared.iter().filter(|run| run.held_out == held_out).count();
        if let Some(error) = prediction_error(&compared, held_out).filter(|_| count > 1) {
            say!(
                "All {count} {kind}runs: the prediction error is {} times what noise explains.",
                three_digits(error)
            );
        }
    }
    say!("\nPredictions: {PREDICTION_RULE}.");
    for run in &compared {
        say!("\n{}{}", run.comparison.run, if run.held_out { " (held out)" } else { "" });
        print_errors(&run.comparison);
        for remark in &run.comparison.remarks {
            say!("  note: {remark}");
        }
    }
    for gaps in runs.gaps() {
        say!("\nnote: {gaps}");
    }
    arguments.explain.write_json(|| as_json(&runs.known.platform, &compared, given.as_deref()))?;
    let page = whorl_report::comparison_html(&compared, of_model.as_deref(), &runs.facts);
    let page = arguments.explain.write_page("compare.html", &page)?;
    say!("\npage: {}", page.display());
    Ok(())
}

/// "As given, ...; refitted, ...".
fn said_of_refit(given: &[ComparedRun], refitted: &[ComparedRun]) -> String {
    let error = |runs: &[ComparedRun]| match (prediction_error(runs, false), prediction_error(runs, true)) {
        (Some(training), Some(held_out)) => format!("{training:.2} times the noise (held out {held_out:.2})"),
        (Some(training), None) => format!("{training:.2} times the noise"),
        _ => "unknown".to_owned(),
    };
    format!(
        "Prediction error with the model as given: {}; with the platform's own parameters refitted to the runs, held-out ones excepted: {}. All that follows is with the refitted model.",
        error(given),
        error(refitted)
    )
}

/// RMS, ratio to the predicted deviation and fit of every channel at every horizon.
fn print_errors(comparison: &Comparison) {
    let Some(first) = comparison.channels.first() else { return };
    let mut headings: Vec<String> = ["channel", "unit", "#noise"].into_iter().map(str::to_owned).collect();
    for h in &first.horizons {
        let name = h.horizon_s.map_or_else(|| "run".to_owned(), |s| format!("{} s", ahead(s)));
        headings.extend([format!("#RMS {name}"), "#ratio".to_owned(), "#fit %".to_owned()]);
    }
    let row = |channel: &whorl_validation::comparison::ChannelErrors| {
        let (unit, factor) = channel.quantity.shown_unit();
        let mut cells =
            vec![channel.name.clone(), unit.to_owned(), three_digits(channel.noise_floor * factor)];
        for h in &channel.horizons {
            let fit = h.fit_percent.map_or_else(|| "-".to_owned(), |f| format!("{f:.1}"));
            cells.extend([three_digits(h.rms * factor), three_digits(h.ratio), fit]);
        }
        cells
    };
    let rows: Vec<Vec<String>> = comparison.channels.iter().map(row).collect();
    print(&headings, &rows);
    let a = &comparison.absolute;
    say!(
        "  chi-squared per degree of freedom of the whole run {} (99 % band {:.3} to {:.3})",
        three_digits(a.chi_squared_per_degree),
        a.band_99.0,
        a.band_99.1
    );
    if comparison.unexplained.is_some() {
        say!("  unexplained: {}", comparison.unexplained);
    }
}
