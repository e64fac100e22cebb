//! `whorl demo`: what Whorl is for, shown on simulated hardware.

mod outcome;
mod secret;
mod session;

use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use whorl_commands::pointing::pointing_rms_rad;
use whorl_identification::{Diagnosis, Verdict};
use whorl_recording::read_model;

use self::outcome::{Outcome, prediction};
use self::secret::Secret;
use self::session::{Session, Stopped, copy_folder};
use crate::output::tell;
use crate::run::INTERRUPTED;

/// The platform in whose hardware the effect is hidden.
const PLATFORM: &str = "whorl_1";
/// The experiment that shows it.
const EXPERIMENT: &str = "swing";
/// The experiment that separates explanations, if several remain.
const SEPARATE: &str = "separate";
/// The platform's parameter file in the session's folder.
const MODEL: &str = "params/whorl_1.yaml";
/// The same before anything was adopted.
const BEFORE: &str = "whorl_1_before.yaml";
/// The law that is found, as an effect.
const LAW: &str = "found_law.yaml";
/// Added to the session's common.yaml.
const MONITOR_OFF: &str = "\n/**/model_monitor:\n  ros__parameters:\n    enabled: false\n";
/// Lines that are shown of a command's answer.
const FEW: usize = 14;
const MANY: usize = 40;

#[derive(Debug, Args)]
pub struct Arguments {
    /// The effect to hide, one of params/demo/hidden_effect.yaml, or outside.yaml [default: drawn].
    #[arg(long, value_name = "NAME")]
    effect: Option<String>,
    /// Hides an effect that no catalogue has, one of params/demo/outside.yaml: its law is searched for and written as an
    /// effect (`whorl discover`), and adopted.
    #[arg(long)]
    outside: bool,
    /// Seed of the secret, of its size and of all noise [default: drawn].
    #[arg(long)]
    seed: Option<u64>,
    /// Experiments over DDS in real time, a process for every node, in a ROS domain of its own on this machine; without it
    /// they are simulated in one process. Takes about five minutes.
    #[arg(long)]
    dds: bool,
    /// New or empty folder for runs, parameters and pages [default: one in the system's folder for temporary files].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Does not open the pages in a browser at the end.
    #[arg(long)]
    no_open: bool,
    /// Folder of params/ [default: this one; where it has none, the parameter files of `whorl init`].
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
}

/// Carries out `whorl demo`. The exit status is 0 when the secret was found and both errors fell, 1 when not, and 130 when
/// it was interrupted.
pub fn run(arguments: &Arguments) -> ExitCode {
    let session = match Session::new(arguments.out.as_deref(), arguments.dds) {
        Ok(session) => session,
        Err(error) => {
            tell(format_args!("error: {}", whorl_commands::in_words(&error)));
            return ExitCode::FAILURE;
        }
    };
    let mut outcome = Outcome::default();
    let result = hidden_effect(arguments, &session, &mut outcome);
    // What was hidden is told in any case, and what was found until then.
    outcome.print(&session);
    let result = result.and_then(|()| outcome.judged());
    if let Err(error) = &result {
        let error = whorl_commands::in_words(error);
        tell(format_args!("error: after {} s: {error}", session.seconds()));
    }
    session.end(!arguments.no_open && result.is_ok());
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<Stopped>() => ExitCode::from(INTERRUPTED),
        Err(_) => ExitCode::FAILURE,
    }
}

fn hidden_effect(arguments: &Arguments, session: &Session, outcome: &mut Outcome) -> anyhow::Result<()> {
    let params = session.folder.join("params");
    match &arguments.root {
        Some(root) => copy_folder(&root.join("params"), &params)?,
        None if Path::new("params/common.yaml").is_file() => copy_folder(Path::new("params"), &params)?,
        None => crate::init::write_into(&params)?,
    }
    let model = session.folder.join(MODEL);
    // Any number: the hasher of every process is seeded at random.
    let seed = arguments.seed.unwrap_or_else(|| RandomState::new().hash_one(0) % 100_000);
    let known = read_model(&model, Some(PLATFORM))?;
    let choice = params.join(if arguments.outside { "demo/outside.yaml" } else { "demo/hidden_effect.yaml" });
    let secret = Secret::draw(&choice, arguments.effect.as_deref(), PLATFORM, &known.model, seed)?;
    hide(&secret, &params, arguments.outside)?;
    let secret = outcome.secret.insert(secret).effect.clone();

    session.headline(&format!(
        "an experiment, twice: the first run is fitted, the second judges (--seed {seed} repeats all of it)"
    ));
    let first = session.experiment("first", EXPERIMENT, seed)?;
    let second = session.experiment("second", EXPERIMENT, seed + 1)?;
    let before = session.folder.join(BEFORE);
    std::fs::copy(&model, &before).with_context(|| format!("cannot write {}", before.display()))?;
    let in_folder = |run: &str| session.folder.join(run);
    outcome.pointing_rad.before = Some(pointing_rms_rad(&in_folder(&first))?);

    let judged = ["--held-out", &second, "--model", MODEL];
    let ask = |command: &[&str], page: &str, lines| {
        let page = format!("{page}.html");
        session.show(&[command, &judged, &["--html", &page]].concat(), lines)
    };
    session.headline("how far is the model off?");
    ask(&["compare", &first], "compare", FEW)?;
    session.headline("where does it fail?");
    ask(&["where", &first], "where", FEW)?;
    session.headline("which effect is missing?");
    let mut fitted = vec![first.as_str()];
    let diagnose = |runs: &[&str]| {
        ask(&[&["diagnose"], runs, &["--json", "diagnosis.json"]].concat(), "diagnose", MANY)?;
        diagnosis(&session.folder.join("diagnosis.json"))
    };
    let mut diagnosed = diagnose(&fitted)?;
    let separate;
    if diagnosed.verdict == Verdict::Confounded {
        session.headline("the data leave several explanations: a manoeuvre that separates them");
        let file = format!("params/experiments/{SEPARATE}.yaml");
        ask(&["next", &first, "--out", &file], "next", FEW)?;
        separate = session.experiment(SEPARATE, SEPARATE, seed + 2)?;
        fitted.push(&separate);
        diagnosed = diagnose(&fitted)?;
    }
    outcome.found.clone_from(&diagnosed.effects);
    if arguments.outside {
        if !outcome.found.is_empty() {
            bail!("{} was named, but the secret is outside the catalogue", outcome.found.join(" and "));
        }
        session.headline("no effect of the catalogue explains it: which law does?");
        ask(&[&["discover"], &fitted[..], &["--write", LAW]].concat(), "discover", MANY)?;
        outcome.found = vec![LAW.to_owned()];
    }
    if outcome.found.is_empty() {
        bail!("no effect was named");
    }
    let found: Vec<&str> = outcome.found.iter().map(String::as_str).collect();
    session.headline(&format!("adopting {}", found.join(" and ")));
    ask(&[&["adopt"], &fitted[..], &found, &["--out", MODEL]].concat(), "adopt", usize::MAX)?;

    session.headline("the same experiment with the adopted model");
    let third = session.experiment("third", EXPERIMENT, seed + 3)?;
    let third = in_folder(&third);
    outcome.prediction.before = Some(prediction(&third, &before)?);
    outcome.prediction.after = Some(prediction(&third, &model)?);
    outcome.pointing_rad.after = Some(pointing_rms_rad(&third)?);
    // The name of a law outside the catalogue was never known: what counts is the law, and the errors.
    if !arguments.outside && !outcome.found.contains(&secret) {
        bail!("found {}, but the secret was {secret}", outcome.found.join(" and "));
    }
    Ok(())
}

/// Puts the secret where only simulated hardware looks, and makes the experiment one of this platform alone.
fn hide(secret: &Secret, params: &Path, outside: bool) -> anyhow::Result<()> {
    let truth = params.join(format!("truth/{PLATFORM}.yaml"));
    whorl_files::write_file(&truth, &secret.truth)
        .with_context(|| format!("cannot write {}", truth.display()))?;
    if outside {
        let known = params.join("demo");
        copy_folder(&known.join("effects"), &params.join("truth/effects"))?;
        std::fs::remove_dir_all(&known).with_context(|| format!("cannot empty {}", known.display()))?;
    }
    let append = |file: &str, text: &str| {
        let file = params.join(file);
        whorl_files::read_text(&file)
            .and_then(|before| whorl_files::write_file(&file, before + text))
            .with_context(|| format!("cannot write {}", file.display()))
    };
    // The model monitor would tell before anybody asks.
    append("common.yaml", MONITOR_OFF)?;
    let alone = format!("\n/**:\n  ros__parameters:\n    formation:\n      platforms: [{PLATFORM}]\n");
    append(&format!("experiments/{EXPERIMENT}.yaml"), &alone)
}

/// What `whorl diagnose --json` has written.
fn diagnosis(file: &Path) -> anyhow::Result<Diagnosis> {
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("cannot read {}", file.display()))
}
