//! How far a model is from recorded runs: `cargo run -p whorl_explain --example compare [RUN_DIRECTORY...]`.

mod support;

use whorl_explain::{compare, prediction_error};

fn main() -> anyhow::Result<()> {
    let material = support::Material::read()?;
    let runs = compare(&material.case(), &mut |_, _| {})?;
    for run in &runs {
        println!("{}", run.comparison.answer());
        for channel in &run.comparison.channels {
            let ratios: Vec<String> = channel.horizons.iter().map(|h| format!("{:.2}", h.ratio)).collect();
            println!("  {}: error over noise at each horizon {}", channel.name, ratios.join(", "));
        }
    }
    for (held_out, kind) in [(false, "training"), (true, "held-out")] {
        if let Some(error) = prediction_error(&runs, held_out) {
            println!("prediction error of the {kind} runs: {error:.3} times the noise");
        }
    }
    Ok(())
}
