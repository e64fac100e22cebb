//! `whorl history`: how a platform's model came to be.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde_json::json;
use whorl_bag::RunDirectory;
use whorl_commands::options;
use whorl_explain::trends::{Change, ChangeKind, DatedRun, Trend, Trends, trends};
use whorl_explain::{EffectInModel, History, ParameterInModel, history};
use whorl_math::three_digits;
use whorl_params::ModelStep;
use whorl_recording::read_model;

use crate::output::{JsonArgument, say};
use crate::progress;
use crate::runs::{RunArguments, RunContext, write};
use crate::table::print;

/// Version of the JSON output.
const SCHEMA: u32 = 1;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Parameter file of a platform, or a run directory: how its model came to be. Two or more runs: what changed from
    /// run to run.
    #[arg(required = true, value_name = "MODEL_OR_RUNS")]
    sources: Vec<PathBuf>,
    /// Name of the platform, where there are several.
    #[arg(long, value_name = "NAME")]
    platform: Option<String>,
    #[command(flatten)]
    json: JsonArgument,
    /// Of several runs: tests only what differs between those before this run and those from it on.
    #[arg(long, value_name = "RUN")]
    since: Option<PathBuf>,
    /// Of several runs: the platform's parameter file [default: the parameters saved in the first run].
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Of several runs: map of topics or columns, for runs that Whorl did not record.
    #[arg(long, value_name = "FILE")]
    channels: Option<PathBuf>,
    /// Of several runs: path of the HTML page [default: history.html in the first run's directory].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// Carries out `whorl history`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let [_, _, ..] = arguments.sources.as_slice() {
        return over_runs(arguments);
    }
    let source = arguments.sources.first().context("no model and no run was given")?;
    let known = read_model(source, arguments.platform.as_deref())?;
    let history = history(&known);
    arguments.json.write(|| Ok(as_json(&history)))?;
    if history.steps.is_empty() {
        say!("No adoption is noted in the model of {}.", history.platform);
    }
    for step in &history.steps {
        print_step(step);
    }
    print_effects(&history);
    if !history.sources.is_empty() {
        say!("\nWhere the standard deviations are from");
    }
    for (source, keys) in &history.sources {
        say!("  {source}: {}", keys.join(", "));
    }
    Ok(())
}

/// A change that is told: one in a hundred of histories without any tells one.
const TOLD: f64 = 0.01;
const HEADINGS: [&str; 9] =
    ["effect", "parameter", "unit", "#runs", "#scatter", "change", "#by", "#+-", "#chance"];

fn over_runs(arguments: &Arguments) -> anyhow::Result<()> {
    let runs = RunArguments {
        runs: arguments.sources.clone(),
        context: RunContext {
            held_out: Vec::new(),
            model: arguments.model.clone(),
            platform: arguments.platform.clone(),
            channels: arguments.channels.clone(),
        },
    };
    let read = progress::during("reading the runs", || runs.read())?;
    let began = arguments.sources.iter().map(|path| began_s(path)).collect::<anyhow::Result<Vec<f64>>>()?;
    let dated: Vec<DatedRun<'_>> = read
        .training
        .iter()
        .zip(&began)
        .map(|(recording, began_s)| DatedRun { recording, began_s: *began_s })
        .collect();
    let since = match &arguments.since {
        None => None,
        Some(run) => {
            let place = arguments.sources.iter().position(|source| source == run).with_context(|| {
                format!("--since {}: it is none of the runs that were given", run.display())
            })?;
            let from = began[place];
            Some(began.iter().filter(|other| **other < from).count())
        }
    };
    let (model, prior) = (&read.known.model, &read.known.prior);
    let found =
        progress::watched("fitting every run", |say| trends(&dated, model, prior, since, &options(), say))?;
    let (answer, rows) = (sentences(&found), rows(&found));
    arguments.json.write(|| Ok(trends_as_json(&found)))?;
    let page = arguments.html.clone().unwrap_or_else(|| {
        let first = arguments.sources.first().map_or(Path::new(""), PathBuf::as_path);
        if first.is_dir() { first.join("history.html") } else { first.with_file_name("history.html") }
    });
    write(&page, &whorl_report::trends_html(&found, &answer, &HEADINGS, &rows, &read.facts))?;
    for sentence in &answer {
        say!("{sentence}");
    }
    say!();
    print(&HEADINGS.map(str::to_owned), &rows);
    say!("\npage: {}", page.display());
    Ok(())
}

/// When a run began \[s since 1970\]: as its manifest says, else when its file was written.
fn began_s(path: &Path) -> anyhow::Result<f64> {
    if let Ok(manifest) = RunDirectory::open(path).and_then(|run| run.manifest_or_from_bag()) {
        return Ok(manifest.start_utc.0 as f64 * 1e-9);
    }
    let written = std::fs::metadata(path)
        .and_then(|file| file.modified())
        .with_context(|| format!("{}: when it began is not known", path.display()))?;
    Ok(written.duration_since(std::time::UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64()))
}

fn sentences(found: &Trends) -> Vec<String> {
    let mut told: Vec<String> = found
        .changed(TOLD)
        .map(|(trend, change)| {
            let unit = if trend.unit == "1" { String::new() } else { format!(" {}", trend.unit) };
            let (size, stddev) = (three_digits(change.size), three_digits(change.stddev));
            let name = format!("{} {}", trend.group, trend.name);
            let sure = format!("{:.1} sigma after all that was looked at", change.sigma_after);
            match change.kind {
                ChangeKind::Step { from } => {
                    let run = found.runs.get(from).map_or("?", |(run, _)| run.as_str());
                    format!("Since {run}: {name} has changed by {size} +- {stddev}{unit}, {sure}.")
                }
                ChangeKind::Drift => {
                    format!("{name} drifts by {size} +- {stddev}{unit} a day, {sure}.")
                }
            }
        })
        .collect();
    if told.is_empty() {
        told.push(format!(
            "Nothing has changed beyond chance in {} runs ({} tests).",
            found.runs.len() - found.left_out.len(),
            found.tests
        ));
    }
    told.extend(found.left_out.iter().map(|(run, why)| format!("{run} was left out: {why}.")));
    told
}

fn rows(found: &Trends) -> Vec<Vec<String>> {
    let row = |trend: &Trend| {
        let change = trend.change.as_ref();
        let kind = change.map_or_else(String::new, |change| match change.kind {
            ChangeKind::Step { from } => {
                format!("at {}", found.runs.get(from).map_or("?", |(run, _)| run.as_str()))
            }
            ChangeKind::Drift => "drift, a day".to_owned(),
        });
        let number = |of: fn(&Change) -> f64| change.map_or_else(String::new, |c| three_digits(of(c)));
        vec![
            trend.group.clone(),
            trend.name.clone(),
            trend.unit.clone(),
            trend.estimates.len().to_string(),
            format!("{:.2}", trend.scatter),
            kind,
            number(|c| c.size),
            number(|c| c.stddev),
            number(|c| c.chance),
        ]
    };
    found.trends.iter().map(row).collect()
}

fn trends_as_json(found: &Trends) -> serde_json::Value {
    let trend = |trend: &Trend| {
        let estimates: Vec<_> = trend
            .estimates
            .iter()
            .map(|e| json!({"run": e.run, "value": e.value, "stddev": e.stddev}))
            .collect();
        let change = trend.change.as_ref().map(|c| {
            let (kind, from) = match c.kind {
                ChangeKind::Step { from } => ("step", Some(from)),
                ChangeKind::Drift => ("drift_per_day", None),
            };
            json!({"kind": kind, "from_run": from, "size": c.size, "stddev": c.stddev, "sigma": c.sigma,
               "chance": c.chance, "sigma_after": c.sigma_after})
        });
        json!({"group": trend.group, "name": trend.name, "unit": trend.unit, "model": trend.model,
           "scatter": trend.scatter, "estimates": estimates, "change": change})
    };
    let runs: Vec<_> =
        found.runs.iter().map(|(name, began_s)| json!({"name": name, "began_unix_s": began_s})).collect();
    let left: Vec<_> = found.left_out.iter().map(|(run, why)| json!({"run": run, "why": why})).collect();
    json!({"schema": SCHEMA, "runs": runs, "tests": found.tests, "left_out": left,
       "parameters": found.trends.iter().map(trend).collect::<Vec<_>>()})
}

fn print_step(step: &ModelStep) {
    let what = match step.effects.as_slice() {
        [] => "own parameters estimated".to_owned(),
        effects => format!("adopted {}", effects.join(" and ")),
    };
    say!("{:>3}  {}  {what}", step.number, step.date.as_deref().unwrap_or("(no date)"));
    for (error, kind) in [(step.prediction_error, "training"), (step.held_out_prediction_error, "held-out")] {
        if let Some([before, after]) = error {
            say!("     prediction error on {kind} runs {before:.2} -> {after:.2} times the noise");
        }
    }
    if let Some(source) = &step.source {
        say!("     {source}");
    }
}

fn print_effects(history: &History) {
    if history.effects.is_empty() {
        say!("The model has no effects beyond the base model.");
        return;
    }
    let row = |effect: &EffectInModel, parameter: &ParameterInModel| {
        let steps: Vec<String> = effect.adopted_in.iter().map(u32::to_string).collect();
        vec![
            effect.effect.clone(),
            parameter.name.clone(),
            three_digits(parameter.value),
            parameter.stddev.map_or_else(String::new, three_digits),
            parameter.unit.to_owned(),
            if steps.is_empty() { "by hand".to_owned() } else { format!("in step {}", steps.join(", ")) },
        ]
    };
    let rows: Vec<Vec<String>> =
        history.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| row(e, p))).collect();
    say!("\nEffects in the model");
    print(&["effect", "parameter", "#value", "#+-", "unit", "adopted"].map(str::to_owned), &rows);
}

fn as_json(history: &History) -> serde_json::Value {
    let steps: Vec<_> = history
        .steps
        .iter()
        .map(|step| {
            json!({"number": step.number, "date": step.date, "effects": step.effects,
               "prediction_error": step.prediction_error,
               "held_out_prediction_error": step.held_out_prediction_error, "source": step.source})
        })
        .collect();
    let effects: Vec<_> = history
        .effects
        .iter()
        .map(|effect| {
            let parameters: Vec<_> = effect
                .parameters
                .iter()
                .map(|p| json!({"name": p.name, "unit": p.unit, "value": p.value, "stddev": p.stddev}))
                .collect();
            json!({"effect": effect.effect, "adopted_in": effect.adopted_in, "parameters": parameters})
        })
        .collect();
    let sources: Vec<_> =
        history.sources.iter().map(|(source, keys)| json!({"source": source, "parameters": keys})).collect();
    json!({"schema": SCHEMA, "platform": history.platform, "steps": steps, "effects": effects, "sources": sources})
}
