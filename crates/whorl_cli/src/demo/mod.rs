//! `whorl demo`: what Whorl is for, shown on simulated hardware with real processes over DDS.

mod secret;
mod session;

use std::hash::{BuildHasher, RandomState};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, Subcommand};
use whorl_bag::RunDirectory;
use whorl_diagnosis::{Diagnosis, Verdict};
use whorl_explain::{Case, compare, prediction_error};
use whorl_math::deg_from_rad;
use whorl_msgs::topics::Message;
use whorl_recording::{ReadOptions, read_model, read_run_with};

use self::secret::Secret;
use self::session::{Session, Stopped, copy_folder};
use crate::output::{say, tell};
use crate::run::INTERRUPTED;

/// The platform in whose hardware the effect is hidden.
const PLATFORM: &str = "whorl_1";
/// The experiment that shows it.
const EXPERIMENT: &str = "swing";
/// The experiment that separates explanations, if several remain.
const SEPARATE: &str = "separate";
/// The platform's parameter file in the session's folder.
const MODEL: &str = "params/whorl_1.yaml";
/// The law that is found, as an effect.
const LAW: &str = "found_law.yaml";
/// Added to the session's common.yaml.
const MONITOR_OFF: &str = "\n/**/model_monitor:\n  ros__parameters:\n    enabled: false\n";
/// Lines that are shown of a command's answer.
const FEW: usize = 14;
const MANY: usize = 40;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Hides an effect in a simulated platform that its model does not have; finds it, adopts it, and compares.
    ///
    /// Over DDS in a ROS domain of its own on this machine: an experiment, how far off the model is, where, which effect is
    /// missing, adopting it, and the same experiment with the new model. Prints both errors before and after. Takes about
    /// five minutes.
    HiddenEffect(HiddenEffect),
}

#[derive(Debug, Args)]
pub struct HiddenEffect {
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
    /// New or empty folder that keeps runs, parameters and pages [default: they are removed at the end].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder of params/.
    #[arg(long, value_name = "DIR", default_value = ".")]
    root: PathBuf,
}

/// Carries out `whorl demo`. The exit status is 0 when the secret was found and both errors fell, 1 when not, and 130 when
/// it was interrupted.
pub fn run(command: &Command) -> ExitCode {
    let Command::HiddenEffect(arguments) = command;
    let result = Session::new(arguments.out.as_deref(), &arguments.root).and_then(|session| {
        hidden_effect(arguments, &session)
            .inspect_err(|_| match session.kept {
                true => tell(format_args!("kept in {}", session.folder.display())),
                false => tell("nothing was kept; with --out DIR runs, parameters and pages are"),
            })
            .with_context(|| format!("after {} s", session.seconds()))
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell(format_args!("error: {}", whorl_commands::in_words(&error)));
            if error.is::<Stopped>() { ExitCode::from(INTERRUPTED) } else { ExitCode::FAILURE }
        }
    }
}

fn hidden_effect(arguments: &HiddenEffect, session: &Session) -> anyhow::Result<()> {
    let params = arguments.root.join("params");
    let model = session.folder.join(MODEL);
    copy_folder(&params, &session.folder.join("params"))?;
    // Any number: the hasher of every process is seeded at random.
    let seed = arguments.seed.unwrap_or_else(|| RandomState::new().hash_one(0) % 100_000);
    let known = read_model(&model, Some(PLATFORM))?;
    let choice = params.join(if arguments.outside { "demo/outside.yaml" } else { "demo/hidden_effect.yaml" });
    let secret = Secret::draw(&choice, arguments.effect.as_deref(), PLATFORM, &known.model, seed)?;
    let truth = session.folder.join(format!("params/truth/{PLATFORM}.yaml"));
    if arguments.outside {
        // Only the simulated hardware may know it.
        let (known, hidden) =
            (session.folder.join("params/demo"), session.folder.join("params/truth/effects"));
        copy_folder(&params.join("demo/effects"), &hidden)?;
        std::fs::remove_dir_all(&known).with_context(|| format!("cannot empty {}", known.display()))?;
    }
    // The model monitor would tell the secret before anybody asks.
    let common = session.folder.join("params/common.yaml");
    std::fs::OpenOptions::new()
        .append(true)
        .open(&common)
        .and_then(|mut file| file.write_all(MONITOR_OFF.as_bytes()))
        .with_context(|| format!("cannot write {}", common.display()))?;
    whorl_files::write_file(&truth, &secret.truth)
        .with_context(|| format!("cannot write {}", truth.display()))?;

    session
        .headline(&format!("an experiment, twice: the first run is fitted, the second judges (seed {seed})"));
    let first = session.experiment("first", EXPERIMENT, PLATFORM, seed)?;
    let second = session.experiment("second", EXPERIMENT, PLATFORM, seed + 1)?;
    let before = session.folder.join("whorl_1_before.yaml");
    std::fs::copy(&model, &before).with_context(|| format!("cannot write {}", before.display()))?;

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
        ask(&[&["diagnose"], runs, &["--json", "diagnosis.json"]].concat(), "diagnosis", MANY)?;
        diagnosis(&session.folder.join("diagnosis.json"))
    };
    let mut diagnosed = diagnose(&fitted)?;
    let separate;
    if diagnosed.verdict == Verdict::Confounded {
        session.headline("the data leave several explanations: a manoeuvre that separates them");
        let file = format!("params/experiments/{SEPARATE}.yaml");
        ask(&["next", &first, "--out", &file], "next", FEW)?;
        separate = session.experiment(SEPARATE, SEPARATE, PLATFORM, seed + 2)?;
        fitted.push(&separate);
        diagnosed = diagnose(&fitted)?;
    }
    let mut found: Vec<&str> = diagnosed.effects.iter().map(String::as_str).collect();
    if arguments.outside {
        if !found.is_empty() {
            bail!("{} was named, but the secret is outside the catalogue", found.join(" and "));
        }
        session.headline("no effect of the catalogue explains it: which law does?");
        ask(&[&["discover"], &fitted[..], &["--write", LAW]].concat(), "discover", MANY)?;
        found = vec![LAW];
    }
    if found.is_empty() {
        bail!("no effect was named; the secret was {}: {}", secret.effect, secret.parameters);
    }
    session.headline(&format!("adopting {}", found.join(" ")));
    ask(&[&["adopt"], &fitted[..], &found, &["--out", MODEL]].concat(), "adopt", usize::MAX)?;

    session.headline("the same experiment with the adopted model");
    let third = session.experiment("third", EXPERIMENT, PLATFORM, seed + 3)?;
    let in_folder = |run: &str| session.folder.join(run);
    let prediction = [prediction(&in_folder(&third), &before)?, prediction(&in_folder(&third), &model)?];
    let pointing = [pointing_rms_rad(&in_folder(&first))?, pointing_rms_rad(&in_folder(&third))?];

    session.headline("the secret was");
    say!("  {}: {}", secret.effect, secret.parameters);
    say!("found: {}\n", found.join(" "));
    say!("{:<44} {:>10} {:>10}", "", "before", "after");
    let [a, b] = prediction;
    say!("{:<44} {a:>10.2} {b:>10.2}", "prediction error of the new run (1 = noise)");
    let [c, d] = pointing.map(deg_from_rad);
    say!("{:<44} {c:>10.4} {d:>10.4}", "pointing error [deg RMS]");
    if arguments.outside {
        // The name was never known: what counts is the law, printed above beside the secret's, and the errors.
        say!("the secret's law: {}", secret.equation);
    } else if !found.contains(&secret.effect.as_str()) {
        bail!("found {}, but the secret was {}", found.join(" and "), secret.effect);
    }
    for ([before, after], what) in [(prediction, "prediction"), (pointing, "pointing")] {
        if after >= before {
            bail!("the {what} error did not fall");
        }
    }
    if found.len() > 1 {
        say!("more was found than the secret: what its formula leaves");
    }
    say!("both errors fell, in {} s", session.seconds());
    if session.kept {
        say!("pages: {}/*.html", session.folder.display());
    }
    Ok(())
}

/// What `whorl diagnose --json` has written.
fn diagnosis(file: &Path) -> anyhow::Result<Diagnosis> {
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("cannot read {}", file.display()))
}

/// Prediction error of a model on a run, relative to the noise.
fn prediction(run: &Path, model: &Path) -> anyhow::Result<f64> {
    let known = read_model(model, Some(PLATFORM))?;
    let options = ReadOptions { platform: Some(PLATFORM), model: Some(&known.model), channels: None };
    let runs = read_run_with(run, &options)?;
    let case = Case { training: &runs, held_out: &[], model: &known.model, prior: &known.prior };
    prediction_error(&compare(&case, &mut |_, _| {})?, false)
        .with_context(|| format!("{} cannot be predicted", run.display()))
}

/// RMS angle between attitude and reference over the whole run \[rad\], by the controller.
fn pointing_rms_rad(run: &Path) -> anyhow::Result<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for message in RunDirectory::open(run)?.bag()?.messages() {
        let message = message?;
        if !message.topic.name.ends_with("/control/status") {
            continue;
        }
        if let Ok(Message::ControlStatus(status)) = message.decode() {
            let error = status.attitude_error_b_rad;
            let squared = error.x * error.x + error.y * error.y + error.z * error.z;
            // Without a reference there is no error.
            if squared.is_finite() {
                (sum, count) = (sum + squared, count + 1);
            }
        }
    }
    if count == 0 {
        bail!("{} has no attitude errors", run.display());
    }
    Ok((sum / f64::from(count)).sqrt())
}
