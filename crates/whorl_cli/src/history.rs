//! `whorl history`: how a platform's model came to be.

use std::path::PathBuf;

use serde_json::json;
use whorl_explain::{EffectInModel, History, ParameterInModel, history};
use whorl_math::three_digits;
use whorl_params::ModelStep;
use whorl_recording::read_model;

use crate::runs::write;
use crate::table::print;

/// Version of the JSON output.
const SCHEMA: u32 = 1;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Parameter file of a platform, or a run directory: the model as it was in that run.
    #[arg(value_name = "MODEL_OR_RUN")]
    source: PathBuf,
    /// Name of the platform, where there are several.
    #[arg(long, value_name = "NAME")]
    platform: Option<String>,
    /// Writes everything as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Carries out `whorl history`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let known = read_model(&arguments.source, arguments.platform.as_deref())?;
    let history = history(&known);
    if let Some(path) = &arguments.json {
        write(path, &serde_json::to_string_pretty(&as_json(&history))?)?;
    }
    if history.steps.is_empty() {
        println!("No adoption is noted in the model of {}.", history.platform);
    }
    for step in &history.steps {
        print_step(step);
    }
    print_effects(&history);
    if !history.sources.is_empty() {
        println!("\nWhere the standard deviations are from");
    }
    for (source, keys) in &history.sources {
        println!("  {source}: {}", keys.join(", "));
    }
    Ok(())
}

fn print_step(step: &ModelStep) {
    let what = match step.effects.as_slice() {
        [] => "own parameters estimated".to_owned(),
        effects => format!("adopted {}", effects.join(" and ")),
    };
    println!("{:>3}  {}  {what}", step.number, step.date.as_deref().unwrap_or("(no date)"));
    for (error, kind) in [(step.prediction_error, "training"), (step.held_out_prediction_error, "held-out")] {
        if let Some([before, after]) = error {
            println!("     prediction error on {kind} runs {before:.2} -> {after:.2} times the noise");
        }
    }
    if let Some(source) = &step.source {
        println!("     {source}");
    }
}

fn print_effects(history: &History) {
    if history.effects.is_empty() {
        println!("The model has no effects beyond the base model.");
        return;
    }
    let row = |effect: &EffectInModel, parameter: &ParameterInModel| {
        let steps: Vec<String> = effect.adopted_in.iter().map(u32::to_string).collect();
        vec![
            effect.effect.clone(),
            parameter.name.clone(),
            three_digits(parameter.value),
            parameter.stddev.map_or_else(String::new, three_digits),
            parameter.unit.to_owned(),
            if steps.is_empty() { "by hand".to_owned() } else { format!("in step {}", steps.join(", ")) },
        ]
    };
    let rows: Vec<Vec<String>> =
        history.effects.iter().flat_map(|e| e.parameters.iter().map(move |p| row(e, p))).collect();
    println!("\nEffects in the model");
    print(&["effect", "parameter", "#value", "#+-", "unit", "adopted"].map(str::to_owned), &rows);
}

fn as_json(history: &History) -> serde_json::Value {
    let steps: Vec<_> = history
        .steps
        .iter()
        .map(|step| {
            json!({"number": step.number, "date": step.date, "effects": step.effects,
               "prediction_error": step.prediction_error,
               "held_out_prediction_error": step.held_out_prediction_error, "source": step.source})
        })
        .collect();
    let effects: Vec<_> = history
        .effects
        .iter()
        .map(|effect| {
            let parameters: Vec<_> = effect
                .parameters
                .iter()
                .map(|p| json!({"name": p.name, "unit": p.unit, "value": p.value, "stddev": p.stddev}))
                .collect();
            json!({"effect": effect.effect, "adopted_in": effect.adopted_in, "parameters": parameters})
        })
        .collect();
    let sources: Vec<_> =
        history.sources.iter().map(|(source, keys)| json!({"source": source, "parameters": keys})).collect();
    json!({"schema": SCHEMA, "platform": history.platform, "steps": steps, "effects": effects, "sources": sources})
}
