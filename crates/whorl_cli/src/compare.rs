//! `whorl compare`: how far a model is from recorded runs.

use serde_json::Value;
use whorl_commands::compare::{as_json, refitted};
use whorl_explain::{ComparedRun, compare, prediction_error};
use whorl_math::three_digits;
use whorl_validation::Comparison;
use whorl_validation::comparison::PREDICTION_RULE;

use crate::explain::ExplainArguments;
use crate::output::say;
use crate::progress;
use crate::runs::{RunSources, Runs};
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

/// One platform's runs, compared.
struct OfPlatform {
    runs: Runs,
    compared: Vec<ComparedRun>,
    /// With the model as given, where it was refitted.
    given: Option<Vec<ComparedRun>>,
}

/// Carries out `whorl compare`: of every platform whose model there is, if none was chosen.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let sources = arguments.explain.runs.sources().of_each_platform()?;
    let each = sources.iter().map(|sources| of_platform(sources, arguments.refit));
    let each = each.collect::<anyhow::Result<Vec<OfPlatform>>>()?;
    let of_models: Vec<String> = each.iter().filter_map(said_of_refit).collect();
    for of_model in &of_models {
        say!("{of_model}");
    }
    for of in &each {
        print_answers(&of.compared);
    }
    say!("\nPredictions: {PREDICTION_RULE}.");
    for run in each.iter().flat_map(|of| &of.compared) {
        say!("\n{}{}", run.comparison.title(), if run.held_out { " (held out)" } else { "" });
        print_errors(&run.comparison);
        for remark in &run.comparison.remarks {
            say!("  note: {remark}");
        }
    }
    for gaps in each.iter().flat_map(|of| of.runs.gaps()) {
        say!("\nnote: {gaps}");
    }
    arguments.explain.write_json(|| {
        let as_json = |of: &OfPlatform| as_json(&of.runs.known.platform, &of.compared, of.given.as_deref());
        match each.as_slice() {
            [only] => as_json(only),
            all => all.iter().map(as_json).collect::<anyhow::Result<Vec<_>>>().map(Value::Array),
        }
    })?;
    // Where a model fails is asked of one platform: the first whose model does.
    let is_left = |of: &OfPlatform| of.compared.iter().any(|run| !run.comparison.is_noise());
    let left = sources.iter().zip(&each).find(|(_, of)| is_left(of));
    let next = left.map(|(sources, _)| sources.command("where", &[]));
    let facts: Vec<(String, String)> = each.iter().flat_map(|of| of.runs.facts.clone()).collect();
    let compared: Vec<ComparedRun> = each.into_iter().flat_map(|of| of.compared).collect();
    let page = whorl_report::comparison_html(&compared, &of_models, &facts);
    let page = arguments.explain.write_page("compare.html", &page)?;
    say!("\npage: {}", page.display());
    if let Some(next) = next {
        say!("next: {next}");
    }
    Ok(())
}

fn of_platform(sources: &RunSources, refit: bool) -> anyhow::Result<OfPlatform> {
    let runs = progress::during("reading the runs", || sources.read())?;
    let (given, compared) = if refit {
        let (given, refitted) =
            progress::watched("refitting and comparing", |say| refitted(&runs.case(), say))?;
        (Some(given), refitted)
    } else {
        (None, progress::watched("comparing the runs", |say| compare(&runs.case(), say))?)
    };
    Ok(OfPlatform { runs, compared, given })
}

fn print_answers(compared: &[ComparedRun]) {
    for run in compared {
        say!("{}{}", run.comparison.answer(), if run.held_out { " (Held out: never fitted.)" } else { "" });
        say!("  {}", run.comparison.said_of_innovations());
    }
    for (held_out, kind) in [(false, ""), (true, "held-out ")] {
        let count = compared.iter().filter(|run| run.held_out == held_out).count();
        if let Some(error) = prediction_error(compared, held_out).filter(|_| count > 1) {
            say!(
                "All {count} {kind}runs: the prediction error is {} times what noise explains.",
                three_digits(error)
            );
        }
    }
}

/// "As given, ...; refitted, ...".
fn said_of_refit(of: &OfPlatform) -> Option<String> {
    let given = of.given.as_ref()?;
    let error = |runs: &[ComparedRun]| match (prediction_error(runs, false), prediction_error(runs, true)) {
        (Some(training), Some(held_out)) => format!("{training:.2} times the noise (held out {held_out:.2})"),
        (Some(training), None) => format!("{training:.2} times the noise"),
        _ => "unknown".to_owned(),
    };
    Some(format!(
        "{}: prediction error with the model as given: {}; with the platform's own parameters refitted to the runs, held-out ones excepted: {}. All that follows is with the refitted model.",
        of.runs.known.platform,
        error(given),
        error(&of.compared)
    ))
}

/// RMS, predicted deviation and ratio of every channel at every horizon; the page has the fit, too.
fn print_errors(comparison: &Comparison) {
    let Some(first) = comparison.channels.first() else { return };
    let mut headings: Vec<String> = ["channel", "unit", "#noise"].into_iter().map(str::to_owned).collect();
    for h in &first.horizons {
        headings.extend(whorl_report::horizon_columns(h).into_iter().take(3));
    }
    let row = |channel: &whorl_validation::comparison::ChannelErrors| {
        let (unit, factor) = channel.quantity.shown_unit();
        let mut cells =
            vec![channel.name.clone(), unit.to_owned(), three_digits(channel.noise_floor * factor)];
        for h in &channel.horizons {
            cells.extend([h.rms * factor, h.predicted_stddev * factor, h.ratio].map(three_digits));
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
