//! One run of a campaign, in memory.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use whorl_bag::{BagError, BagOptions, RunDescription, RunWriter};
use whorl_msgs::topics::{Message, Route, Topic};
use whorl_node::{LogLevel, LogLine, Timestamp};
use whorl_params::ParameterTree;
use whorl_report::Collector;
use whorl_sim::{NodeSet, Observer};

use crate::row::{METRICS, Row, Traffic, metrics};
use crate::run_spec::RunSpec;

/// Keeps the messages for the numbers, and writes the run directory if requested.
struct Keeper {
    names: Vec<String>,
    data: Collector,
    broadcasts: Option<u64>,
    errors: Vec<String>,
    writer: Option<RunWriter>,
}

/// Topics that no metric uses.
fn unused(topic: Topic) -> bool {
    matches!(
        topic,
        Topic::ImuRaw
            | Topic::VectorDirection
            | Topic::ActuatorCommand
            | Topic::Battery
            | Topic::TankPressure
            | Topic::Temperature
            | Topic::Tf
            | Topic::FormationCommand
    )
}

impl Observer for Keeper {
    type Error = BagError;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), BagError> {
        if let Some(writer) = &mut self.writer {
            writer.write_message(route, now, message)?;
        }
        if let Message::DiagnosticArray(array) = &**message {
            let values =
                array.status.iter().filter(|s| s.name == "coordinator: experiment").flat_map(|s| &s.values);
            let counted = values.filter(|v| v.key == "broadcasts").find_map(|v| v.value.parse().ok());
            self.broadcasts = counted.or(self.broadcasts);
        } else if !unused(route.topic) {
            let platform = route.platform.and_then(|id| self.names.get(usize::from(id.0)));
            if route.platform.is_none() || platform.is_some() {
                self.data.add_on(route.topic, platform.map(String::as_str), now.0, message);
            }
        }
        Ok(())
    }

    fn logged(&mut self, _now: Timestamp, node: &str, line: &LogLine) {
        if line.level == LogLevel::Error {
            self.errors.push(format!("{node}: {}", line.text));
        }
    }
}

/// Whether a run can begin.
///
/// # Errors
/// If the parameters are invalid, with the reason.
pub fn check(spec: &RunSpec) -> Result<(), String> {
    let tree = ParameterTree::load(&spec.layers, &spec.overrides).map_err(|e| e.to_string())?;
    NodeSet::build(&tree, spec.seed, Timestamp(0)).map(|_| ()).map_err(|e| e.to_string())
}

/// Simulates a run. A failure is noted in its row and does not end the campaign. With `keep`, the run directory
/// is written there.
#[must_use]
pub fn simulate(spec: &RunSpec, longest_s: f64, keep: Option<&Path>) -> Row {
    let row = |outcome: &str, reason: String, metrics: Vec<f64>| Row {
        index: spec.index,
        experiment: spec.experiment.clone(),
        seed: spec.seed,
        labels: spec.labels.clone(),
        outcome: outcome.to_owned(),
        reason: reason.replace(['\n', '\r'], " "),
        metrics,
    };
    let nothing = vec![f64::NAN; METRICS.len()];
    let built = ParameterTree::load(&spec.layers, &spec.overrides)
        .map_err(|e| e.to_string())
        .and_then(|tree| NodeSet::build(&tree, spec.seed, Timestamp(0)).map_err(|e| e.to_string()));
    let mut set = match built {
        Ok(set) => set,
        Err(reason) => return row("refused", reason, nothing),
    };
    let writer = match keep.map(|folder| open(spec, &set, folder)).transpose() {
        Ok(writer) => writer,
        Err(error) => return row("failed", error.to_string(), nothing),
    };
    let mut keeper = Keeper {
        names: set.platforms.clone(),
        data: Collector::for_numbers(),
        broadcasts: None,
        errors: vec![],
        writer,
    };
    let outcome = whorl_sim::run(&mut set, Duration::from_secs_f64(longest_s), &mut keeper, |_| ());
    let closed = keeper.writer.take().map(|w| w.finish(Timestamp(0))).transpose();
    match (outcome, closed) {
        (Ok(outcome), Ok(_)) => {
            let data = keeper.data.finish();
            let summary = whorl_report::summarise(&data);
            let traffic = Traffic { link_messages: set.bus.link_messages(), broadcasts: keeper.broadcasts };
            let numbers = metrics(&data, &summary, outcome.simulated_s, &traffic);
            let reason = if summary.outcome == "finished" { String::new() } else { keeper.errors.join("; ") };
            row(&summary.outcome, reason, numbers)
        }
        (Err(error), _) | (_, Err(error)) => row("failed", error.to_string(), nothing),
    }
}

fn open(spec: &RunSpec, set: &NodeSet, folder: &Path) -> Result<RunWriter, BagError> {
    let description = RunDescription {
        experiment: spec.experiment.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        seed: Some(spec.seed),
        simulated_time: true,
        platforms: set.platforms.clone(),
        ..RunDescription::default()
    };
    let mut writer = RunWriter::create_in(folder, description, Timestamp(0), BagOptions::default())?;
    writer.add_parameter_files(&spec.layers)?;
    writer.add_parameters(
        "effective.yaml",
        "the parameters in force",
        set.effective_parameters.as_bytes(),
    )?;
    Ok(writer)
}
