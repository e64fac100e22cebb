//! `whorl diagnose`: which physical effect a model lacks.

use std::path::PathBuf;

use whorl_commands::diagnose::{as_json, as_lines, with_next};
use whorl_commands::runs::write;
use whorl_commands::settings::as_yaml;
use whorl_commands::tables::write_diagnosis;
use whorl_identification::{Diagnosis, Settings, Verdict};
use whorl_math::three_digits;

use crate::explain::{ExplainArguments, SearchArguments};
use crate::output::{say, text};
use crate::progress;
use crate::runs::RunSources;
use crate::table::print;

/// Effects listed in the table.
const LISTED: usize = 12;

/// Arguments of `whorl diagnose`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
    #[command(flatten)]
    search: SearchArguments,
    /// Writes every effect tested as a row of a Parquet file, in DIR/platform=NAME/run=NAME/: diagnoses of many runs are
    /// one table.
    #[arg(long, value_name = "DIR")]
    parquet: Option<PathBuf>,
    /// Writes every set of effects that was fitted, one JSON object a line: parameters, log evidence, prior, probability.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Prints every number that a verdict depends on, those of the predictor among them, with its meaning and source, and ends.
    #[arg(long, exclusive = true)]
    settings: bool,
}

/// Carries out `whorl diagnose`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.settings {
        text(&as_yaml(&Settings::default()));
        return Ok(());
    }
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let options = arguments.search.options()?;
    let found = progress::watched("diagnosing", |say| with_next(&runs, &options, say))?;
    for sentence in found.answer() {
        say!("{sentence}");
    }
    say!();
    print_candidates(&found.diagnosis);
    for remark in &found.diagnosis.remarks {
        say!("note: {remark}");
    }
    arguments.explain.write_json(|| as_json(&found))?;
    if let Some(path) = &arguments.trace {
        write(path, &as_lines(&found.diagnosis.fitted)?)?;
        say!("\nsets that were fitted: {}", path.display());
    }
    if let Some(folder) = &arguments.parquet {
        let of: Vec<&str> = runs.training.iter().map(|run| run.name.as_str()).collect();
        let table = write_diagnosis(&as_json(&found)?, &runs.known.platform, &of, folder)?;
        say!("\ntable: {}", table.path.display());
    }
    let page = whorl_report::diagnosis_html(&found, &runs.facts);
    let page = arguments.explain.write_page("diagnose.html", &page)?;
    say!("\npage: {}", page.display());
    if let Some(next) = next(&arguments.explain.runs.sources(), &found.diagnosis) {
        say!("next: {next}");
    }
    Ok(())
}

/// What to do with the verdict: adopt what was named, find the law or the run that is missing.
fn next(sources: &RunSources, diagnosis: &Diagnosis) -> Option<String> {
    Some(match diagnosis.verdict {
        Verdict::Named => {
            let effects: Vec<&str> = diagnosis.effects.iter().map(String::as_str).collect();
            sources.command("adopt", &[&effects[..], &["--out", &sources.out()]].concat())
        }
        Verdict::Confounded | Verdict::NotEnoughInformation => {
            sources.command("next", &["--out", "params/experiments/separate.yaml"])
        }
        Verdict::Unknown => sources.command("discover", &["--write", "found_law.yaml"]),
        Verdict::NothingMissing => return None,
    })
}

fn print_candidates(diagnosis: &Diagnosis) {
    let headings =
        ["effect", "#log evidence", "#held out", "#of excess %", "#lambda", "#absorbed %", "estimate"]
            .map(str::to_owned);
    let rows: Vec<Vec<String>> = diagnosis
        .candidates
        .iter()
        .take(LISTED)
        .map(|c| {
            let estimates: Vec<String> = c
                .parameters
                .iter()
                .take(2)
                .map(|p| {
                    format!(
                        "{} {} +- {} {}",
                        p.name,
                        three_digits(p.estimate),
                        three_digits(p.stddev),
                        p.unit
                    )
                })
                .collect();
            vec![
                c.effect.clone(),
                format!("{:.1}", c.delta_log_evidence),
                c.held_out_gain.map_or_else(|| "-".to_owned(), |gain| format!("{gain:.1}")),
                format!("{:.0}", 100.0 * c.share_of_excess),
                three_digits(c.detectability),
                format!("{:.0}", 100.0 * c.swallowed_by_base),
                estimates.join(", "),
            ]
        })
        .collect();
    print(&headings, &rows);
}
