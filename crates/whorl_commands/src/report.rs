//! Page and numbers of a recorded run.

use std::path::{Path, PathBuf};

use anyhow::bail;
use whorl_bag::{BagError, Manifest, RunDirectory, RunState};
use whorl_math::rad_from_deg;
use whorl_params::ParameterTree;
use whorl_report::{Circumstances, Collector, Description, RunData, RunVerdict, Summary, TopicRow};

use crate::page::NewPage;
use crate::runs::{is_csv, of_new};
use crate::shapes::{number, shapes};

/// Key of the recorder's note that its computer's clock was set.
const CLOCK_SET: &str = "clock_set";

/// What was written, and what the run came to.
#[derive(Debug)]
pub struct Written {
    /// The page.
    pub page: PathBuf,
    /// Why the page is in the working directory, if the run could not be written to.
    pub moved: Option<String>,
    /// The numbers.
    pub summary: Summary,
    /// The verdict.
    pub verdict: RunVerdict,
    /// Why the numbers could not be kept with the run, if they could not.
    pub not_kept: Option<String>,
}

/// A run in memory.
#[derive(Debug)]
pub struct ReadRun {
    /// What its messages say.
    pub data: RunData,
    directory: RunDirectory,
    /// Whether its recorder was killed.
    recovered: bool,
    undecodable: u64,
}

/// Reads the messages of a run.
///
/// # Errors
/// When there are none, or they cannot be read.
pub fn read(path: &Path) -> anyhow::Result<ReadRun> {
    let mut directory = RunDirectory::open(path)?;
    let recovered = directory.manifest().is_some_and(|m| m.state == RunState::Recording);
    if recovered {
        match directory.recover() {
            Ok(_) => {}
            // Where nothing can be written what is there is read as it is.
            Err(BagError::Io { .. } | BagError::DiskFull { .. }) => directory = RunDirectory::open(path)?,
            Err(error) => return Err(error.into()),
        }
    }
    let bag = directory.bag()?;
    let mut data = Collector::default();
    let mut undecodable = 0u64;
    for message in bag.messages() {
        let message = message?;
        if message.topic.message_type().is_none() {
            continue;
        }
        match message.decode() {
            Ok(decoded) => data.add(&message.topic.name, message.log_time.0, &decoded),
            Err(_) => undecodable += 1,
        }
    }
    let data = data.finish();
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
    Ok(ReadRun { data, directory, recovered, undecodable })
}

/// Writes page and numbers of one run; the page goes to `html`, else into the run.
///
/// # Errors
/// As [`read`], and when a file cannot be written.
pub fn write(path: &Path, html: Option<&Path>) -> anyhow::Result<Written> {
    if is_csv(path) {
        bail!(
            "{}: a report is of a run that Whorl recorded, and a CSV file is none: {} writes model and map of its columns, with which \
             `whorl compare` and the others take it",
            path.display(),
            of_new(path)
        );
    }
    // Before the work, which may take minutes.
    let page = NewPage::create(path, "report.html", html, Path::new(""))?;
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
    let verdict = whorl_report::judge(
        &data,
        &summary,
        &circumstances(description.target_rad, &manifest, parameters.as_ref()),
    );
    let moved = page.moved.clone();
    let page = page.finish(&whorl_report::html(&data, &summary, &verdict, &description))?;
    let mut not_kept = None;
    if let serde_json::Value::Object(mut entries) = serde_json::to_value(&summary)? {
        entries.insert("verdict".to_owned(), serde_json::to_value(&verdict)?);
        not_kept = run.update_summary(&entries).err().map(|error| error.to_string());
    }
    Ok(Written { page, moved, summary, verdict, not_kept })
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
        secured: manifest.description.is_secured(),
        clock_set: manifest
            .description
            .notes
            .iter()
            .find(|(key, _)| key == CLOCK_SET)
            // Without when: in seconds since 1970.
            .map(|(_, said)| said.split(" at ").next().unwrap_or(said).to_owned()),
    }
}

/// The parameters of the run; one without any, such as an imported one, has none.
#[must_use]
pub fn effective_parameters(path: &Path) -> Option<ParameterTree> {
    let text = whorl_files::read_text(&path.join("params/effective.yaml")).ok()?;
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
