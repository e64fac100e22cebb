//! `whorl report`: page and numbers of a recorded run.

use std::path::{Path, PathBuf};

use crate::shapes::{number, shapes};
use anyhow::{Context, bail};
use whorl_bag::{Manifest, RunDirectory, RunState};
use whorl_math::{deg_from_rad, rad_from_deg};
use whorl_params::ParameterTree;
use whorl_report::{Circumstances, Description, RunData, RunVerdict, Summary, TopicRow};

/// Carries out `whorl report`.
pub fn run(runs: &[PathBuf], html: Option<&Path>) -> anyhow::Result<()> {
    if html.is_some() && runs.len() > 1 {
        bail!("--html needs exactly one RUN; {} were given", runs.len());
    }
    for path in runs {
        let report = write(path, html)?;
        print(&report);
    }
    Ok(())
}

/// What was written, and what the run came to.
pub struct Written {
    /// The page.
    pub page: PathBuf,
    /// The numbers.
    pub summary: Summary,
    /// The verdict.
    pub verdict: RunVerdict,
}

/// The headline numbers, where the page is, and the verdict: the last line is what a run came to.
pub fn print(report: &Written) {
    print_headline(&report.summary);
    println!("report: {}", report.page.display());
    println!("verdict: {}", report.verdict.line);
}

/// A run in memory.
pub struct ReadRun {
    /// Its messages.
    pub data: RunData,
    directory: RunDirectory,
    /// Whether its recorder was killed.
    recovered: bool,
    undecodable: u64,
}

/// Reads the messages of a run.
pub fn read(path: &Path) -> anyhow::Result<ReadRun> {
    let mut directory = RunDirectory::open(path)?;
    let recovery = match directory.manifest().map(|m| m.state.clone()) {
        Some(RunState::Recording) => directory.recover().map(Some)?,
        _ => None,
    };
    let bag = directory.bag()?;
    let mut data = RunData::default();
    let mut undecodable = 0u64;
    for message in bag.messages() {
        let message = message?;
        if message.topic.message_type().is_none() {
            continue;
        }
        match message.decode() {
            Ok(decoded) => data.add(&message.topic.name, message.log_time.0, decoded),
            Err(_) => undecodable += 1,
        }
    }
    if data.platforms.is_empty() {
        if bag.topics().iter().any(|topic| topic.name.ends_with("/imu/data_raw")) {
            bail!("{} holds no message of any platform: none was received during recording", path.display());
        }
        bail!(
            "{} holds none of Whorl's topics (such as /whorl_1/imu/data_raw); it holds: {}",
            path.display(),
            bag.topics().iter().map(|t| t.name.as_str()).collect::<Vec<_>>().join(", ")
        );
    }
    Ok(ReadRun { data, directory, recovered: recovery.is_some(), undecodable })
}

/// Writes page and numbers of one run.
pub fn write(path: &Path, html: Option<&Path>) -> anyhow::Result<Written> {
    let ReadRun { data, directory: run, recovered, undecodable } = read(path)?;
    let manifest = run.manifest_or_from_bag()?;
    let summary = whorl_report::summarise(&data);
    let parameters = effective_parameters(path);
    let mut description = describe(path, &manifest, parameters.as_ref());
    if recovered {
        description
            .warnings
            .push("The recorder was killed; the report covers the run up to its last second.".to_owned());
    }
    if let RunState::Stopped(reason) = &manifest.state {
        description.warnings.push(format!("The recording ended early: {reason}"));
    }
    if undecodable > 0 {
        description.warnings.push(format!("{undecodable} messages do not fit their type and were left out."));
    }
    let page = html.map_or_else(
        || if path.is_dir() { path.join("report.html") } else { path.with_extension("html") },
        Path::to_owned,
    );
    let verdict = whorl_report::judge(
        &data,
        &summary,
        &circumstances(description.target_rad, &manifest, parameters.as_ref()),
    );
    std::fs::write(&page, whorl_report::html(&data, &summary, &verdict, &description))
        .with_context(|| format!("cannot write {}", page.display()))?;
    if let serde_json::Value::Object(mut entries) = serde_json::to_value(&summary)? {
        entries.insert("verdict".to_owned(), serde_json::to_value(&verdict)?);
        run.update_summary(&entries)?;
    }
    Ok(Written { page, summary, verdict })
}

/// Gas in the tank of a platform's model at the start \[kg\]; `None` without jets.
fn gas_kg(parameters: &ParameterTree, name: &str) -> Option<f64> {
    let own = parameters.for_node(&format!("/{name}/local_control"));
    let model = whorl_params::platform_model(&mut whorl_params::Reader::new(&own), "model")?;
    (!model.jets().is_empty()).then(|| model.tank().initial_gas_kg())
}

fn circumstances(
    target_rad: Option<f64>,
    manifest: &Manifest,
    parameters: Option<&ParameterTree>,
) -> Circumstances {
    let coordinator = parameters.map(|p| p.for_node("/coordinator"));
    let target = |(key, _): &(&str, &str)| {
        let value = number(coordinator.as_ref()?, &format!("experiment.targets.{key}"))?;
        (value > 0.0).then(|| ((*key).to_owned(), value))
    };
    let of = |name: &String| Some((name.clone(), gas_kg(parameters?, name)?));
    Circumstances {
        target_rad,
        targets: whorl_coordinator::parameters::TARGETS.iter().filter_map(target).collect(),
        gas_kg: manifest.description.platforms.iter().filter_map(of).collect(),
        incomplete: match &manifest.state {
            RunState::Stopped(reason) => Some(reason.clone()),
            RunState::Recovered => Some("the recorder was killed".to_owned()),
            _ => None,
        },
        messages: manifest.message_count(),
        lost: manifest.lost(),
    }
}

/// The parameters of the run; one without any, such as an imported one, has none.
pub fn effective_parameters(path: &Path) -> Option<ParameterTree> {
    let text = std::fs::read_to_string(path.join("params/effective.yaml")).ok()?;
    ParameterTree::from_texts(&[("effective.yaml", text.as_str())], &[]).ok()
}

fn target_rad(parameters: &ParameterTree) -> Option<f64> {
    let target_deg = number(&parameters.for_node("/coordinator"), "experiment.target_deg")?;
    (target_deg > 0.0).then(|| rad_from_deg(target_deg))
}

fn describe(path: &Path, manifest: &Manifest, parameters: Option<&ParameterTree>) -> Description {
    let d = &manifest.description;
    let mut facts = vec![
        ("run".to_owned(), path.display().to_string()),
        ("experiment".to_owned(), d.experiment.clone()),
        ("platforms".to_owned(), d.platforms.join(", ")),
        ("recording".to_owned(), manifest.state.name().to_owned()),
        ("time".to_owned(), if d.simulated_time { "simulated" } else { "real" }.to_owned()),
        ("Whorl version".to_owned(), d.version.clone()),
    ];
    facts.extend(d.git_commit.iter().map(|c| ("git commit".to_owned(), c.clone())));
    facts.extend(d.seed.iter().map(|s| ("seed".to_owned(), s.to_string())));
    facts.extend(d.notes.iter().cloned());
    facts.extend(
        manifest
            .parameters
            .iter()
            .map(|p| (p.file.clone(), format!("sha256 {}", p.sha256.get(..16).unwrap_or(&p.sha256)))),
    );
    Description {
        title: format!("Whorl run: {}", if d.experiment.is_empty() { "recording" } else { &d.experiment }),
        facts,
        topics: manifest
            .topics
            .iter()
            .map(|t| TopicRow {
                name: t.name.clone(),
                type_name: t.type_name.clone(),
                messages: t.count,
                rate_hz: t.rate_hz,
                lost: t.sequence.map(|s| s.lost),
                longest_gap_s: t.largest_gap_s,
            })
            .collect(),
        warnings: Vec::new(),
        shapes: parameters.map(|p| shapes(p, &d.platforms)).unwrap_or_default(),
        target_rad: parameters.and_then(target_rad),
        link_stale_s: parameters.and_then(|p| number(&p.for_node("/coordinator"), "link.stale_s")),
    }
}

/// The headline numbers.
pub fn print_headline(summary: &Summary) {
    println!(
        "{} ({}): {} after {:.1} s",
        summary.experiment, summary.law, summary.outcome, summary.duration_s
    );
    for pair in &summary.pairs {
        if !pair.relative_error_rms_rad.is_finite() {
            println!(
                "  {} to {}: no relative pointing error: the formation did not hold",
                pair.follower, pair.leader
            );
            continue;
        }
        let known = |rad: f64| {
            if rad.is_finite() { format!("{:.4}", deg_from_rad(rad)) } else { "unknown".to_owned() }
        };
        println!(
            "  {} to {}: relative pointing error in hold {:.4} deg RMS ({:.4} max); estimators' share {}, control's share {}{}",
            pair.follower,
            pair.leader,
            deg_from_rad(pair.relative_error_rms_rad),
            deg_from_rad(pair.relative_error_max_rad),
            known(pair.estimator_error_rms_rad),
            known(pair.control_error_rms_rad),
            if pair.from_truth { "" } else { " (from the estimates, without truth)" },
        );
    }
    for platform in &summary.platforms {
        let numbers = [
            ("estimator error", deg_from_rad(platform.estimator_error_rms_rad), 4, "deg RMS"),
            ("gas", platform.gas_used_kg * 1e3, 2, "g"),
            ("sensor to command", platform.sensor_to_command_p99_s * 1e3, 2, "ms (99 %)"),
        ];
        // Numbers that the run does not provide are left out.
        let known = numbers.iter().filter(|(_, value, ..)| value.is_finite());
        let known = known.map(|(label, value, digits, unit)| format!("{label} {value:.digits$} {unit}"));
        println!("  {}: {}", platform.name, known.collect::<Vec<_>>().join(", "));
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_target_of_an_experiment_is_measured() {
        for (key, _) in whorl_coordinator::parameters::TARGETS {
            let platform = whorl_report::PlatformSummary::default();
            assert!(whorl_report::measured(&platform, key).is_some(), "{key}");
        }
    }
}
