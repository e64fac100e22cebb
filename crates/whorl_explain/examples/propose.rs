//! Which manoeuvre shows best what the data leave open: `cargo run --release -p whorl_explain --example propose`.
//!
//! Whorl-I, with friction in its bearing that its model does not have, swings about yaw in simulation. The run is diagnosed;
//! then every manoeuvre is rehearsed on the platform that the leading explanation describes.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use whorl_bag::{BagError, BagOptions, RunDescription, RunWriter};
use whorl_explain::changes::changes;
use whorl_explain::propose::leading_explanation;
use whorl_explain::{Case, diagnose, propose};
use whorl_identification::Options;
use whorl_msgs::topics::{Message, Route};
use whorl_node::{LogLine, Timestamp};
use whorl_params::{Override, ParameterTree, standard_layers};
use whorl_recording::{ReadOptions, Recording, read_model, read_run_with};
use whorl_sim::{NodeSet, Observer, run};

/// The platform.
const PLATFORM: &str = "whorl_1";

fn main() -> anyhow::Result<()> {
    let params = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params");
    let known = read_model(&params.join(format!("{PLATFORM}.yaml")), None)?;
    let simulator = Simulator { params: params.clone(), folder: tempfile::tempdir()? };

    let swing = std::fs::read_to_string(params.join("experiments/swing.yaml"))?;
    let friction = ["effects.bearing_viscous_friction.c_n_m_s:=0.05".to_owned()];
    let training = [simulator.record("swing", &swing, &friction)?];
    let case = Case { training: &training, held_out: &[], model: &known.model, prior: &known.prior };
    let options = Options::default();
    let found = diagnose(&case, &options, &mut |_, _| {})?;
    for sentence in found.answer() {
        println!("{sentence}");
    }

    // The truth of a rehearsal: what the leading explanation changes in the model.
    let leading = leading_explanation(&case, &found.diagnosis, &options);
    let truth: Vec<String> = changes((case.model, &leading), (case.prior, case.prior), "")
        .iter()
        .filter_map(|change| Some(format!("{}:={}", change.key.strip_prefix("model.")?, change.value)))
        .collect();
    let rehearse =
        |name: &str, yaml: &str| simulator.record(name, yaml, &truth).map_err(|error| format!("{error:#}"));
    let proposal = propose(&case, PLATFORM, &found.diagnosis, &options, &rehearse, &mut |_, _| {})?;
    let best = proposal.best().context("no manoeuvre stays within the limits")?;
    println!();
    for sentence in proposal.answer(best, found.diagnosis.verdict, PLATFORM) {
        println!("{sentence}");
    }
    for judged in &proposal.judged {
        let odds = judged.expected.log_odds.map_or_else(|| "-".to_owned(), |odds| format!("{odds:.1}"));
        println!("  {}: {:.0} s, expected log odds {odds}", judged.manoeuvre.name, judged.demand.duration_s);
    }
    Ok(())
}

/// Simulates experiments with the whole node set.
struct Simulator {
    params: PathBuf,
    /// Runs, for a moment each.
    folder: tempfile::TempDir,
}

impl Simulator {
    /// Runs an experiment, given as the text of its file, and reads the measurements. Each line of `truth` changes one
    /// parameter of the simulated hardware: `key:=value`.
    fn record(&self, name: &str, yaml: &str, truth: &[String]) -> anyhow::Result<Recording> {
        let experiment = self.folder.path().join(format!("{name}.yaml"));
        std::fs::write(&experiment, yaml)?;
        let in_truth = |line: &String| Override::parse(&format!("/{PLATFORM}/driver:truth.{line}"));
        let mut overrides = truth.iter().map(in_truth).collect::<Result<Vec<_>, _>>()?;
        overrides.push(Override::parse(&format!("formation.platforms:=[{PLATFORM}]"))?);
        let mut layers = standard_layers(&self.params, &[PLATFORM], Some(&experiment));
        // The rest of the hardware is as the model says.
        layers.retain(|file| !file.starts_with(self.params.join("truth")));
        let tree = ParameterTree::load(&layers, &overrides)?;
        let mut nodes = NodeSet::build(&tree, 1, Timestamp(0))?;

        let folder = self.folder.path().join(name);
        let platforms = nodes.platforms.clone();
        let description = RunDescription { platforms, simulated_time: true, ..RunDescription::default() };
        let writer = RunWriter::create_in(&folder, description, Timestamp(0), BagOptions::default())?;
        let mut recorder = Recorder(writer);
        run(&mut nodes, Duration::from_secs(600), &mut recorder, |_| {})?;
        recorder.0.finish(Timestamp(0))?;
        let options = ReadOptions { platform: Some(PLATFORM), ..ReadOptions::default() };
        let recording = read_run_with(&folder, &options)?.into_iter().next();
        std::fs::remove_dir_all(&folder)?;
        recording.context("nothing was measured")
    }
}

/// Writes everything that is published.
struct Recorder(RunWriter);

impl Observer for Recorder {
    type Error = BagError;

    fn published(&mut self, now: Timestamp, route: Route, message: &Arc<Message>) -> Result<(), BagError> {
        self.0.write_message(route, now, message)
    }

    fn logged(&mut self, _now: Timestamp, _node: &str, _line: &LogLine) {}
}
