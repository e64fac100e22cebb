//! `whorl diagnose`: which physical effect a model lacks.

use whorl_diagnosis::{Diagnosis, DiagnosisError, Options, Progress, diagnose, fit};
use whorl_dynamics::effects::find;
use whorl_dynamics::{Effect, PlatformModel};
use whorl_report::UnexplainedTorque;
use whorl_trajectory::{ResidualTorque, residual_torque};

use crate::runs::{OutputArguments, RunArguments, Runs};
use crate::table::print;
use crate::{next, progress};
use whorl_report::three_digits;

/// Effects listed in the table.
const LISTED: usize = 12;

/// Arguments of `whorl diagnose`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    #[command(flatten)]
    search: SearchArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// How effects are looked for.
#[derive(Debug, clap::Args)]
pub struct SearchArguments {
    /// An effect that is not to be considered, by its id; may be given several times.
    #[arg(long, value_name = "EFFECT")]
    exclude: Vec<String>,
}

impl SearchArguments {
    /// As the search takes them, on all processors.
    pub fn options(&self) -> Options {
        Options {
            exclude: self.exclude.clone(),
            threads: std::thread::available_parallelism().map_or(2, std::num::NonZero::get),
            ..Options::default()
        }
    }
}

/// The diagnosis of runs, with progress.
pub fn asked(runs: &Runs, options: &Options) -> Result<Diagnosis, DiagnosisError> {
    progress::watched("diagnosing", |say| {
        let mut show = |p: Progress| say(p.share, p.doing);
        diagnose(&runs.training, &runs.held_out, &runs.known.model, &runs.known.prior, options, &mut show)
    })
}

/// Carries out `whorl diagnose`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = progress::during("reading the runs", || arguments.runs.read())?;
    let options = arguments.search.options();
    let mut diagnosis = asked(&runs, &options)?;
    if let Some(next) = next::proposal(&runs, &diagnosis, &options) {
        diagnosis.next = Some(next);
    }
    let answer = diagnosis.answer();
    for sentence in &answer {
        println!("{sentence}");
    }
    println!();
    print_candidates(&diagnosis);
    diagnosis.remarks.extend(runs.gaps());
    for remark in &diagnosis.remarks {
        println!("note: {remark}");
    }
    arguments.output.write_json(|| Ok(&diagnosis))?;
    let torque = progress::during("drawing", || unexplained(&runs, &diagnosis));
    let page = whorl_report::diagnosis_html(&diagnosis, &answer, torque.as_ref(), &runs.facts);
    let page = arguments.output.write_page(&arguments.runs, "diagnose.html", &page)?;
    println!("\npage: {}", page.display());
    Ok(())
}

/// What the model leaves of the first run without and with the effects named; nothing of a clamped one.
fn unexplained(runs: &Runs, diagnosis: &Diagnosis) -> Option<UnexplainedTorque> {
    let recording = runs.training.first()?;
    let given = &runs.known.model;
    let left = |model: &PlatformModel| -> Option<ResidualTorque> {
        // What a wrong inertia does is no missing torque: the platform's own parameters are refitted to the run.
        let run = std::slice::from_ref(recording);
        let fitted = fit(run, &[], model, &runs.known.prior, &[], &Options::default()).ok()?;
        residual_torque(recording, &fitted.model).ok()
    };
    let before = left(given)?;
    let mut model = given.clone();
    for id in &diagnosis.effects {
        let found = diagnosis.candidates.iter().find(|c| c.effect == *id)?;
        let values = model.effects.entry(id.clone()).or_default();
        for p in found.parameters.iter().filter(|p| find(id).is_some_and(|e| has(e, given, &p.name))) {
            values.insert(p.name.clone(), p.estimate);
        }
    }
    let after = (!diagnosis.effects.is_empty()).then(|| left(&model)).flatten();
    Some(UnexplainedTorque { run: recording.name.clone(), before, after })
}

fn has(effect: &dyn Effect, model: &PlatformModel, name: &str) -> bool {
    effect.parameters(model).iter().any(|spec| spec.name == name)
}

fn print_candidates(diagnosis: &Diagnosis) {
    let headings =
        ["effect", "#log evidence", "#held out", "#of excess %", "#lambda", "#base takes %", "estimate"]
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
