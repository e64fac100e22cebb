//! `whorl next`: the manoeuvre that tells most about what is still in doubt.

mod design;
mod experiment;
mod family;
mod rehearsal;
#[cfg(test)]
mod tests;
mod words;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::json;
use whorl_diagnosis::{Diagnosis, NextManoeuvre, Options, Verdict};
use whorl_report::{NextPage, PlannedMotion};

use self::design::{Design, Judged};
use crate::diagnose::{SearchArguments, asked};
use crate::progress;
use crate::runs::{OutputArguments, RunArguments, Runs, write};
use crate::table::print;

/// Version of the JSON form.
const SCHEMA: u32 = 1;

/// Arguments of `whorl next`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    runs: RunArguments,
    /// The experiment to write, e.g. params/experiments/separate.yaml.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    search: SearchArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Carries out `whorl next`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let out = &arguments.out;
    let name = match out.file_stem().map(|s| s.to_string_lossy().into_owned()) {
        Some(name) if out.extension().is_some_and(|e| e == "yaml" || e == "yml") => name,
        _ => bail!("--out {} is no experiment file; its name must end in .yaml", out.display()),
    };
    let runs = progress::during("reading the runs", || arguments.runs.read())?;
    let options = arguments.search.options();
    let known = &runs.known;
    let folder = out.parent().and_then(Path::parent);
    let common = design::common_file(known, folder).context(
        "there is no common.yaml beside the model; write the experiment into a parameter folder, e.g. --out params/experiments/separate.yaml",
    )?;
    let diagnosis = asked(&runs, &options)?;
    let design = design::design(known, &common, &runs.training, &diagnosis, &options)?;
    let best = design.best().context("no manoeuvre was found")?;
    let answer = words::answer(&design, best, diagnosis.verdict, &known.platform);
    let comments: Vec<String> = answer
        .iter()
        .flat_map(|sentence| words::wrapped(sentence, 108))
        .chain(["Written by `whorl next`; docs/experiments.md explains every key.".to_owned()])
        .collect();
    let text = experiment::yaml(&name, &known.platform, &best.envelope, &best.manoeuvre, &comments);
    if let Some(parent) = out.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
    }
    write(out, &text)?;
    for sentence in &answer {
        println!("{sentence}");
    }
    println!();
    print(&words::HEADINGS.map(str::to_owned), &words::rows(&design));
    for (name, reason) in &design.left_out {
        println!("note: {name} is left out: even made smaller it {reason}");
    }
    println!("\nexperiment: {}", out.display());
    let of_folder = folder
        .filter(|f| *f != Path::new("params") && f.join(format!("{}.yaml", known.platform)).is_file())
        .map_or_else(String::new, |f| format!(" --params {}", f.display()));
    println!(
        "run it:     launch_scripts/run_experiment.sh {} --platforms {}{of_folder}",
        out.display(),
        known.platform
    );
    let given: Vec<String> = arguments.runs.runs.iter().map(|r| r.display().to_string()).collect();
    println!("then:       whorl diagnose {} NEW_RUN", given.join(" "));
    arguments.output.write_json(|| Ok(as_json(&known.platform, &design, best, &answer)))?;
    let shown = NextPage {
        answer,
        headings: words::HEADINGS.map(str::to_owned).to_vec(),
        rows: words::rows(&design),
        motion: motion(best),
    };
    let page = whorl_report::next_html(&shown, &runs.facts);
    let page = arguments.output.write_page(&arguments.runs, "next.html", &page)?;
    println!("page:       {}", page.display());
    Ok(())
}

/// What `whorl diagnose` says of the next run: the best manoeuvre, where explanations are left or the data could not
/// have shown any. `None` where nothing needs to be separated, or no manoeuvre can be rehearsed.
pub fn proposal(runs: &Runs, diagnosis: &Diagnosis, options: &Options) -> Option<NextManoeuvre> {
    if !matches!(diagnosis.verdict, Verdict::Confounded | Verdict::NotEnoughInformation) {
        return None;
    }
    let common = design::common_file(&runs.known, None)?;
    let design = design::design(&runs.known, &common, &runs.training, diagnosis, options).ok()?;
    let best = design.best()?;
    Some(NextManoeuvre {
        manoeuvre: format!(
            "{} {} ({}); `whorl next` writes it as an experiment",
            runs.known.platform, best.manoeuvre.words, best.manoeuvre.name
        ),
        expected_log_odds: best.prospect.log_odds.unwrap_or(0.0),
    })
}

fn motion(best: &Judged) -> PlannedMotion {
    let recording = &best.motion;
    let attitude = recording.truth.as_ref().map(|t| &t.q_world_body);
    PlannedMotion {
        name: best.manoeuvre.name.to_owned(),
        time_s: attitude.map_or_else(Vec::new, |q| q.time_s.clone()),
        q_world_body: attitude.map_or_else(Vec::new, |q| q.value.clone()),
        wheel_time_s: recording.wheel_speed_rad_s.time_s.clone(),
        wheel_speed_rad_s: recording.wheel_speed_rad_s.value.clone(),
    }
}

fn as_json(platform: &str, design: &Design, best: &Judged, answer: &[String]) -> serde_json::Value {
    let one = |j: &Judged| {
        json!({
            "name": j.manoeuvre.name,
            "manoeuvre": format!("the platform {}", j.manoeuvre.words),
            "expected_log_odds": j.prospect.log_odds,
            "effects_shown": j.prospect.shown,
            "effects_not_shown": j.prospect.not_shown,
            "demand": j.demand,
        })
    };
    json!({
        "schema": SCHEMA,
        "platform": platform,
        "answer": answer,
        "explanations": design.explanations,
        "log_odds_now": design.now.log_odds,
        "effects_shown_now": design.now.shown,
        "next": {
            "manoeuvre": format!("the platform {}", best.manoeuvre.words),
            "expected_log_odds": best.prospect.log_odds.unwrap_or(0.0),
        },
        "manoeuvres": design.judged.iter().map(one).collect::<Vec<_>>(),
        "left_out": design.left_out.iter().map(|(name, reason)| json!({"name": name, "reason": reason})).collect::<Vec<_>>(),
    })
}
