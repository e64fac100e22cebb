//! `whorl history`: how a platform's model came to be.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use whorl_commands::history::{HEADINGS, as_json, began_s, rows, sentences, trends_as_json, write_table};
use whorl_commands::options;
use whorl_explain::trends::trends;
use whorl_params::ModelStep;
use whorl_recording::read_model;

use crate::output::{JsonArgument, say};
use crate::progress;
use crate::runs::{RunArguments, RunContext, link_pages_beside, page_of, write};
use crate::table::print;

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
    /// Of several runs: writes every estimate as a row of a Parquet file, DIR/platform=NAME/history.parquet.
    #[arg(long, value_name = "DIR")]
    parquet: Option<PathBuf>,
    /// Of several runs: path of the HTML page [default: history.html in the first run's directory].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

/// Carries out `whorl history`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let [_, _, ..] = arguments.sources.as_slice() {
        refuse_models(&arguments.sources)?;
        return over_runs(arguments);
    }
    let source = arguments.sources.first().context("no model and no run was given")?;
    let known = read_model(source, arguments.platform.as_deref())?;
    arguments.json.write(|| Ok(as_json(&known)))?;
    if known.history.is_empty() {
        say!("No adoption is noted in the model of {}.", known.platform);
    }
    for step in &known.history {
        print_step(step);
    }
    Ok(())
}

/// A parameter file among several sources is no run.
fn refuse_models(sources: &[PathBuf]) -> anyhow::Result<()> {
    let is_model = |path: &&PathBuf| path.extension().is_some_and(|end| end == "yaml" || end == "yml");
    let Some(model) = sources.iter().find(is_model) else { return Ok(()) };
    let runs: Vec<String> =
        sources.iter().filter(|path| !is_model(path)).map(|path| path.display().to_string()).collect();
    let runs = if runs.is_empty() { "RUN RUN".to_owned() } else { runs.join(" ") };
    let model = model.display();
    bail!(
        "{model} is a platform's file and no run: `whorl history {model}` tells how this model came to be, `whorl history {runs} --model \
         {model}` what changed from run to run"
    )
}

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
    let dated: Vec<_> = read.training.iter().zip(began.iter().copied()).collect();
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
    let table = arguments.parquet.as_ref().map(|folder| write_table(&found, &read.known.platform, folder));
    let table = table.transpose()?;
    let page = arguments.html.clone().unwrap_or_else(|| {
        let first = arguments.sources.first().map_or(Path::new(""), PathBuf::as_path);
        page_of(first, "history.html")
    });
    write(&page, &whorl_report::trends_html(&found, &answer, &HEADINGS, &rows, &read.facts))?;
    link_pages_beside(&page)?;
    for sentence in &answer {
        say!("{sentence}");
    }
    say!();
    print(&HEADINGS.map(str::to_owned), &rows);
    if let Some(table) = &table {
        say!("\ntable: {}", table.path.display());
    }
    say!("\npage: {}", page.display());
    Ok(())
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
