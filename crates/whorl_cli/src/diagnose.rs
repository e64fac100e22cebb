//! `whorl diagnose`: which physical effect a model lacks.

use whorl_diagnosis::Diagnosis;
use whorl_explain::{Explanation, diagnose};
use whorl_math::three_digits;

use crate::explain::{ExplainArguments, SearchArguments};
use crate::table::print;
use crate::{next, progress};

/// Effects listed in the table.
const LISTED: usize = 12;

/// Arguments of `whorl diagnose`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
    #[command(flatten)]
    search: SearchArguments,
}

/// Carries out `whorl diagnose`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let options = arguments.search.options();
    let mut found = progress::watched("diagnosing", |say| diagnose(&runs.case(), &options, say))?;
    if let Some(next) = next::suggestion(&runs, &found.diagnosis, &options) {
        found.diagnosis.next = Some(next);
    }
    for sentence in found.answer() {
        println!("{sentence}");
    }
    println!();
    print_candidates(&found.diagnosis);
    found.diagnosis.remarks.extend(runs.gaps());
    for remark in &found.diagnosis.remarks {
        println!("note: {remark}");
    }
    arguments.explain.write_json(|| as_json(&found))?;
    let page = whorl_report::diagnosis_html(&found, &runs.facts);
    let page = arguments.explain.write_page("diagnose.html", &page)?;
    println!("\npage: {}", page.display());
    Ok(())
}

/// The diagnosis, with the prediction error of each version of the model.
fn as_json(found: &Explanation) -> anyhow::Result<serde_json::Value> {
    let mut value = serde_json::to_value(&found.diagnosis)?;
    let versions: Vec<serde_json::Value> = found
        .versions
        .iter()
        .map(|v| {
            serde_json::json!({
                "name": v.name,
                "effects": v.effects,
                "prediction_error": v.prediction_error(false),
                "held_out_prediction_error": v.prediction_error(true),
            })
        })
        .collect();
    if let Some(object) = value.as_object_mut() {
        object.insert("versions".to_owned(), versions.into());
    }
    Ok(value)
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
                format!("{:.1}", c.held_out_gain),
                format!("{:.0}", 100.0 * c.share_of_excess),
                three_digits(c.detectability),
                format!("{:.0}", 100.0 * c.swallowed_by_base),
                estimates.join(", "),
            ]
        })
        .collect();
    print(&headings, &rows);
}
