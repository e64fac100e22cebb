//! `whorl next`: the manoeuvre that best separates the remaining explanations.

mod tables;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::json;
use whorl_commands::next::{common_file, proposal};
use whorl_explain::Proposal;
use whorl_explain::propose::{Judged, needs_run};
use whorl_identification::Progress;
use whorl_math::words::shell_word;
use whorl_report::{NextPage, PlannedMotion};

use crate::explain::{ExplainArguments, SearchArguments};
use crate::output::say;
use crate::progress;
use crate::runs::{RunSources, write};
use crate::table::print;

/// Version of the JSON output.
const SCHEMA: u32 = 1;

/// Arguments of `whorl next`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    explain: ExplainArguments,
    /// The experiment to write, e.g. params/experiments/separate.yaml.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    search: SearchArguments,
}

/// Carries out `whorl next`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let out = &arguments.out;
    let name = match out.file_stem().map(|s| s.to_string_lossy().into_owned()) {
        Some(name) if out.extension().is_some_and(|e| e == "yaml" || e == "yml") => name,
        _ => bail!("--out {}: an experiment file's name must end in .yaml", out.display()),
    };
    let runs = progress::during("reading the runs", || arguments.explain.runs.read())?;
    let options = arguments.search.options()?;
    let known = &runs.known;
    let folder = out.parent().and_then(Path::parent);
    let common = common_file(known, folder).context(
        "there is no common.yaml beside the model; write the experiment into a parameter folder, e.g. --out params/experiments/separate.yaml",
    )?;
    let diagnosis = progress::watched("diagnosing", |say| {
        let mut show = |p: Progress| say(p.share, p.doing);
        let (training, held_out) = (&runs.training, &runs.held_out);
        whorl_identification::diagnose(training, held_out, &known.model, &known.prior, &options, &mut show)
    })?;
    let proposal = progress::watched("fitting the leading explanation", |say| {
        proposal(&runs, &common, &diagnosis, &options, say)
    })?;
    let best = proposal.judged.first().context("no manoeuvre was found")?;
    let answer = proposal.answer(best, diagnosis.verdict, &known.platform);
    let comments: Vec<String> = answer
        .iter()
        .flat_map(|sentence| tables::wrapped(sentence, 108))
        .chain(["Written by `whorl next`; docs/experiments.md explains every key.".to_owned()])
        .collect();
    let text = best.manoeuvre.yaml(&name, &known.platform, &comments);
    if let Some(parent) = out.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).with_context(|| format!("cannot create {}", parent.display()))?;
    }
    write(out, &text)?;
    for sentence in &answer {
        say!("{sentence}");
    }
    say!();
    print(&tables::HEADINGS.map(str::to_owned), &tables::rows(&proposal));
    for (name, reason) in &proposal.left_out {
        say!("note: {name} is left out: even scaled down it {reason}");
    }
    for remark in runs.left_out() {
        say!("note: {remark}");
    }
    say!("\nexperiment: {}", out.display());
    let of_folder = folder
        .filter(|f| *f != Path::new("params") && f.join(format!("{}.yaml", known.platform)).is_file())
        .map_or_else(String::new, |f| format!(" --params {}", shell_word(&f.display().to_string())));
    let written = shell_word(&out.display().to_string());
    let new_run = format!("runs/{name}");
    say!("next:       whorl simulate --experiment {written}{of_folder} --out {new_run}");
    say!("  over DDS: whorl run {written} --platforms {}{of_folder}", known.platform);
    let sources = arguments.explain.runs.sources();
    let given = RunSources { runs: [sources.runs.as_slice(), &[PathBuf::from(new_run)]].concat(), ..sources };
    say!("then:       {}", given.command("diagnose", &[]));
    let needed = needs_run(diagnosis.verdict);
    arguments.explain.write_json(|| Ok(as_json(&known.platform, &proposal, best, (needed, &answer))))?;
    let shown = NextPage {
        answer,
        headings: tables::HEADINGS.map(str::to_owned).to_vec(),
        rows: tables::rows(&proposal),
        motion: motion(best),
    };
    let page = whorl_report::next_html(&shown, &runs.facts);
    let page = arguments.explain.write_page("next.html", &page)?;
    say!("page:       {}", page.display());
    Ok(())
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

fn as_json(
    platform: &str,
    proposal: &Proposal,
    best: &Judged,
    (needed, answer): (bool, &[String]),
) -> serde_json::Value {
    let one = |j: &Judged| {
        json!({
            "name": j.manoeuvre.name,
            "manoeuvre": format!("the platform {}", j.manoeuvre.words),
            "expected_log_odds": j.expected.log_odds,
            "effects_shown": j.expected.shown,
            "effects_not_shown": j.expected.not_shown,
            "demand": j.demand,
        })
    };
    json!({
        "schema": SCHEMA,
        "platform": platform,
        "answer": answer,
        "needed": needed,
        "explanations": proposal.explanations,
        "log_odds_now": proposal.now.log_odds,
        "effects_shown_now": proposal.now.shown,
        "next": {
            "manoeuvre": format!("the platform {}", best.manoeuvre.words),
            "expected_log_odds": best.expected.log_odds.unwrap_or(0.0),
        },
        "manoeuvres": proposal.judged.iter().map(one).collect::<Vec<_>>(),
        "left_out": proposal.left_out.iter().map(|(name, reason)| json!({"name": name, "reason": reason})).collect::<Vec<_>>(),
    })
}
