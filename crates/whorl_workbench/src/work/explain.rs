//! Compare, where, diagnose, discover: answers that change no file.

use anyhow::Result;
use whorl_commands::diagnose::with_next;
use whorl_commands::{compare, diagnose, discover, locate, options};
use whorl_explain::{ProgressCallback, compare as compare_runs, locate as locate_error};
use whorl_identification::{Options, Progress};
use whorl_math::three_digits;
use whorl_params::effect_yaml;
use whorl_report::{comparison_figures, diagnosis_figures, localisation_figures};

use crate::api::{Ask, FileChange};
use crate::bench::Workbench;
use crate::done::Done;

/// Name of the effect that a discovered law becomes, and how many such there may be.
const LAW: &str = "discovered_law";
const MOST_LAWS: usize = 99;

/// The options of a search, with the effects that were left out.
fn search(bench: &Workbench) -> Options {
    Options { exclude: bench.choice().exclude, ..options() }
}

pub fn compared(bench: &Workbench, say: &mut ProgressCallback<'_>) -> Result<Done> {
    say(0.0, "reading the runs");
    let runs = bench.runs()?;
    let compared = compare_runs(&runs.case(), say)?;
    let held =
        |run: &whorl_explain::ComparedRun| if run.held_out { " (Held out: never fitted.)" } else { "" };
    let mut sentences: Vec<String> =
        compared.iter().map(|run| format!("{}{}", run.comparison.answer(), held(run))).collect();
    for run in &compared {
        let of = if compared.len() > 1 { format!("{}: ", run.comparison.run) } else { String::new() };
        sentences.push(format!("{of}{}", run.comparison.said_of_innovations()));
    }
    sentences.extend(runs.gaps());
    Ok(Done {
        is_answer: true,
        sentences,
        json: compare::as_json(&runs.known.platform, &compared, None)?,
        figures: comparison_figures(&compared),
        ..Done::default()
    })
}

pub fn located(bench: &Workbench, say: &mut ProgressCallback<'_>) -> Result<Done> {
    say(0.0, "reading the runs");
    let runs = bench.runs()?;
    let found = locate_error(&runs.case(), &options(), say)?;
    let mut sentences = found.pooled.answer();
    sentences.push(match &found.not_refitted {
        None => {
            "The platform's own parameters were refitted to the runs first, within their priors.".to_owned()
        }
        Some(reason) => format!("The platform's own parameters are as given: {reason}"),
    });
    sentences.extend(found.pooled.remarks.iter().cloned());
    Ok(Done {
        is_answer: true,
        sentences,
        json: locate::as_json(&runs.known.platform, &found)?,
        figures: localisation_figures(&found),
        ..Done::default()
    })
}

pub fn diagnosed(bench: &Workbench, say: &mut ProgressCallback<'_>) -> Result<Done> {
    say(0.0, "reading the runs");
    let runs = bench.runs()?;
    let found = with_next(&runs, &search(bench), say)?;
    let mut sentences = found.answer();
    sentences.extend(found.diagnosis.remarks.iter().cloned());
    Ok(Done {
        is_answer: true,
        sentences,
        json: diagnose::as_json(&found)?,
        figures: diagnosis_figures(&found),
        ..Done::default()
    })
}

/// Searches for a law; the best one becomes a file of an effect, which can be adopted.
pub fn discovered(bench: &Workbench, say: &mut ProgressCallback<'_>) -> Result<Done> {
    say(0.0, "reading the runs");
    let runs = bench.runs()?;
    let (case, options) = (runs.case(), search(bench));
    let mut of_catalogue = |p: Progress| say(0.4 * p.share, p.doing);
    let (model, prior) = (case.model, case.prior);
    let diagnosis = whorl_identification::diagnose(
        case.training,
        case.held_out,
        model,
        prior,
        &options,
        &mut of_catalogue,
    )?;
    let platform = &runs.known.platform;
    if let Some(reason) = discover::settled(&diagnosis) {
        let json = discover::as_json(platform, &diagnosis, None, std::slice::from_ref(&reason))?;
        let sentences = diagnosis.answer().into_iter().chain([reason]).collect();
        return Ok(Done { is_answer: true, sentences, json, ..Done::default() });
    }
    let named = discover::competitors(&diagnosis);
    let path = |k: usize| bench.folder().join(name(k));
    let free = (1..=MOST_LAWS).find(|k| !path(*k).exists()).unwrap_or(MOST_LAWS);
    let id = id(free);
    let mut rest = |share: f64, doing: &str| say(0.4 + 0.6 * share, doing);
    let found = whorl_identification::discover(
        case.training,
        case.held_out,
        model,
        prior,
        &named,
        &id,
        &options,
        &mut rest,
    )?;
    let answer = discover::answer(&found);
    let mut changes = Vec::new();
    if let Some((law, definition)) = found.best().and_then(|law| Some((law, law.definition.clone()?))) {
        let fitted: Vec<String> = law
            .parameters
            .iter()
            .map(|p| format!("{} = {} {}", p.name, three_digits(p.value), p.unit))
            .collect();
        let comment = format!("{}\nFitted here: {}.", law.sentence, fitted.join(", "));
        let definition = whorl_dynamics::effects::written::Definition { id: id.clone(), ..definition };
        let text = effect_yaml(&definition, &comment);
        whorl_commands::runs::write(&path(free), &text)?;
        changes.push(FileChange { file: name(free), before: String::new(), after: text });
    }
    let mut json = discover::as_json(platform, &diagnosis, Some(&found), &answer)?;
    if let (Some(object), Some(change)) = (json.as_object_mut(), changes.first()) {
        object.insert("written".to_owned(), change.file.clone().into());
    }
    Ok(Done {
        is_answer: true,
        sentences: answer.into_iter().chain(runs.left_out()).collect(),
        json,
        changes,
        again: Vec::<Ask>::new(),
        ..Done::default()
    })
}

fn id(k: usize) -> String {
    if k == 1 { LAW.to_owned() } else { format!("{LAW}_{k}") }
}

fn name(k: usize) -> String {
    format!("{}.yaml", id(k))
}
