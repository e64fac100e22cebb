//! How far a model is from recorded runs, where it fails, which effect it lacks, and what adopting that improves:
//! `cargo run --release -p whorl_explain --example explain [RUN_DIRECTORY...]`.
//!
//! Without runs, two of a platform with friction in its bearing that its model does not include are simulated. If there are several runs, the
//! last one is held out.

#[path = "../../whorl_prediction/src/tests/generator.rs"]
#[allow(clippy::unwrap_used, reason = "simulates a platform that is known to be valid")]
mod generator;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use whorl_dynamics::{ModelPrior, PlatformModel};
use whorl_explain::{Case, adopt, compare, diagnose, locate, prediction_error};
use whorl_identification::Options;
use whorl_params::changes::changes;
use whorl_recording::{Recording, read_model, read_run};

fn main() -> anyhow::Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let (runs, model, prior) = if paths.is_empty() { simulated() } else { read(&paths)? };
    let (training, held_out) = runs.split_at(runs.len().saturating_sub(1).max(1));
    let case = Case { training, held_out, model: &model, prior: &prior };
    let (options, quiet) = (Options::default(), &mut |_: f64, _: &str| {});

    let compared = compare(&case, quiet)?;
    for run in &compared {
        println!("{}", run.comparison.answer());
    }
    for (held_out, kind) in [(false, "training"), (true, "held-out")] {
        if let Some(error) = prediction_error(&compared, held_out) {
            println!("prediction error of the {kind} runs: {error:.3} times the noise");
        }
    }
    println!("\n{}\n", locate(&case, &options, quiet)?.pooled.answer().join("\n"));
    let found = diagnose(&case, &options, quiet)?;
    println!("{}\n", found.answer().join("\n"));
    if found.diagnosis.effects.is_empty() {
        println!("no effect was named: there is nothing to adopt");
        return Ok(());
    }
    let adoption = adopt(&case, &[found.diagnosis.effects], &options, quiet)?;
    println!("{}", adoption.answer().join("\n"));
    match adoption.objection() {
        Some(objection) => println!("not to be adopted: {objection}"),
        None => {
            let fit = adoption.versions.last().and_then(|version| version.fit.as_ref()).context("no fit")?;
            let (models, priors) = ((case.model, &fit.model), (case.prior, &fit.prior));
            for change in changes(models, priors, "this example") {
                println!("  {}: {:?}  # {}", change.key, change.value, change.comment);
            }
        }
    }
    Ok(())
}

fn read(paths: &[String]) -> anyhow::Result<(Vec<Recording>, PlatformModel, ModelPrior)> {
    let known = read_model(Path::new(paths.first().context("no run was named")?), None)?;
    let read = |path: &String| -> anyhow::Result<Recording> {
        let run = read_run(Path::new(path), Some(&known.platform))?;
        run.into_iter().next().with_context(|| format!("{path} holds no measurements"))
    };
    Ok((paths.iter().map(read).collect::<anyhow::Result<_>>()?, known.model, known.prior))
}

fn simulated() -> (Vec<Recording>, PlatformModel, ModelPrior) {
    let model = generator::platform();
    let mut truth = model.clone();
    let friction = BTreeMap::from([("c_n_m_s".to_owned(), 0.3)]);
    truth.effects.insert("bearing_viscous_friction".to_owned(), friction);
    let run = |seed| generator::record(&truth, &generator::Manoeuvre { seed, ..generator::turning() });
    let prior = ModelPrior::typical(&model);
    (vec![run(1), run(2)], model, prior)
}
