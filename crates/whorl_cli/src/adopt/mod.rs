//! `whorl adopt`: a physical effect becomes part of a platform's model.

mod tables;

use std::path::{Path, PathBuf};

use anyhow::bail;
use whorl_commands::adopt::{as_json, pointing, write};
use whorl_commands::model_file::undo_step;
use whorl_commands::options;
use whorl_dynamics::effects::find;
use whorl_explain::adopt;
use whorl_params::load_effect;
use whorl_recording::{RecordingError, load_effects};

use self::tables::{print_parameters, print_versions};
use crate::effects::{is_effect_file, unknown};
use crate::output::say;
use crate::progress;
use crate::provenance::provenance_of_this;
use crate::runs::{OutputArguments, RunArguments, RunContext, RunSources};

/// Arguments of `whorl adopt`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Runs to fit, then the effects to adopt: ids, or files of effects (NAME.yaml); A B and A+B are the same.
    #[arg(required_unless_present = "undo", value_name = "RUN... EFFECT")]
    items: Vec<String>,
    /// Parameter file to change.
    #[arg(long, value_name = "FILE", required_unless_present = "try_")]
    out: Option<PathBuf>,
    /// Compares candidates side by side and writes nothing; `+` joins effects to a set: a,b+c.
    #[arg(long = "try", value_name = "A,B", value_delimiter = ',')]
    try_: Vec<String>,
    /// Takes the last step of the history of the file --out back, to the letter.
    #[arg(long, conflicts_with_all = ["items", "try_", "anyway", "held_out", "model", "html"])]
    undo: bool,
    /// Writes even if the held-out runs are predicted worse, or a mass property moves implausibly far.
    #[arg(long)]
    anyway: bool,
    #[command(flatten)]
    context: RunContext,
    #[command(flatten)]
    output: OutputArguments,
}

/// Carries out `whorl adopt`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let (true, Some(out)) = (arguments.undo, &arguments.out) {
        return undo(out, arguments.context.platform.as_deref());
    }
    let items = with_files_loaded(arguments)?;
    let (run_paths, effects): (Vec<&String>, Vec<&String>) =
        items.iter().partition(|item| find(item).is_none() || Path::new(item.as_str()).exists());
    if let Some(missing) = run_paths.iter().find(|p| !Path::new(p.as_str()).exists()) {
        let path = Path::new(missing.as_str());
        if path.components().count() > 1 || is_effect_file(missing) {
            bail!("{missing} {}", whorl_params::missing(path));
        }
        bail!("{missing} is neither a run nor an effect: {}", unknown(missing));
    }
    let sets: Vec<Vec<String>> = if arguments.try_.is_empty() {
        if effects.is_empty() {
            bail!(
                "name the effect to adopt after the runs; `whorl effects` lists them, `whorl diagnose` finds them"
            );
        }
        vec![effects.iter().map(|e| (*e).clone()).collect()]
    } else {
        let joined = effects.iter().map(|e| (*e).clone());
        arguments
            .try_
            .iter()
            .map(|set| joined.clone().chain(set.split('+').map(str::to_owned)).collect())
            .collect()
    };
    if let Some(id) = sets.iter().flatten().find(|id| find(id).is_none()) {
        bail!(unknown(id));
    }
    let run_arguments = RunArguments {
        runs: run_paths.iter().map(PathBuf::from).collect(),
        context: RunContext {
            // The effect is added to the file's present content.
            model: arguments
                .context
                .model
                .clone()
                .or_else(|| arguments.out.clone().filter(|out| out.exists())),
            ..arguments.context.clone()
        },
    };
    let runs = progress::during("reading the runs", || run_arguments.read())?;
    let adoption =
        progress::watched("comparing the runs", |say| adopt(&runs.case(), &sets, &options(), say))?;
    let answer = adoption.answer();
    let command = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let provenance = provenance_of_this(&run_arguments)?;
    // Before anything is printed: the reader may close the pipe after a few lines.
    let written = if arguments.try_.is_empty() {
        let now = whorl_ros::wall_clock();
        write(arguments.out.as_deref(), arguments.anyway, &runs, &adoption, &provenance, now)
    } else {
        Ok("Nothing was written: --try only compares.".to_owned())
    };
    for sentence in &answer {
        say!("{sentence}");
    }
    say!();
    print_versions(&adoption.versions);
    for version in adoption.versions.iter().filter(|v| !v.effects.is_empty()) {
        print_parameters(version);
    }
    for (version, reason) in &adoption.left_out {
        say!("note: {version}: {reason}");
    }
    for remark in runs.left_out() {
        say!("note: {remark}");
    }
    say!("\n{}", written?);
    let simulated = match (&arguments.out, arguments.try_.is_empty()) {
        (Some(out), true) => {
            let (pointing, said) = progress::during("simulating an experiment", || pointing(&runs, out));
            say!("{said}");
            pointing
        }
        _ => None,
    };
    arguments.output.write_json(|| {
        as_json(&runs.known.platform, &adoption.versions, &answer, &provenance, simulated.as_ref())
    })?;
    let mut facts = runs.facts.clone();
    facts.push(("command".to_owned(), format!("whorl {command}")));
    facts.push(("provenance".to_owned(), provenance));
    let page = whorl_report::adoption_html(&adoption, &facts);
    let page = arguments.output.write_page(&run_arguments, "adopt.html", &page)?;
    say!("page: {}", page.display());
    if let (true, Some(out)) = (arguments.try_.is_empty(), &arguments.out) {
        // What was not fitted judges.
        let runs = match run_arguments.context.held_out.as_slice() {
            [] => run_arguments.runs.clone(),
            held_out => held_out.to_vec(),
        };
        let sources =
            RunSources { runs, held_out: Vec::new(), model: Some(out.clone()), ..run_arguments.sources() };
        say!("next: {}", sources.command("compare", &[]));
    }
    Ok(())
}

fn undo(file: &Path, platform: Option<&str>) -> anyhow::Result<()> {
    let step = undo_step(file, platform)?;
    let what = match step.effects.as_slice() {
        [] => step.source.unwrap_or_default(),
        effects => effects.join(" and "),
    };
    let date = step.date.map_or_else(String::new, |date| format!(" of {date}"));
    say!("{} is as before step {}{date}: {what}", file.display(), step.number);
    Ok(())
}

/// The items, sets (`A+B`) taken apart, files of effects replaced by the ids under which they are known from now on; effects that belong to the
/// parameter files are known, too.
fn with_files_loaded(arguments: &Arguments) -> anyhow::Result<Vec<String>> {
    let runs = arguments.items.iter().map(PathBuf::from).filter(|path| path.is_dir());
    let files = arguments.context.model.iter().chain(&arguments.out).cloned();
    for source in files.chain(runs).filter(|path| path.exists()) {
        // What is wrong with a run is reported when it is read.
        if let Err(RecordingError::Parameters(errors)) = load_effects(&source) {
            return Err(errors.into());
        }
    }
    let named = |item: &String| -> anyhow::Result<String> {
        if !is_effect_file(item) {
            return Ok(item.clone());
        }
        Ok(load_effect(Path::new(item))?.info().id.to_owned())
    };
    let parts = |item: &String| -> Vec<String> {
        // Names of runs may have a plus.
        if Path::new(item).exists() {
            vec![item.clone()]
        } else {
            item.split('+').map(str::to_owned).collect()
        }
    };
    arguments.items.iter().flat_map(parts).map(|item| named(&item)).collect()
}
