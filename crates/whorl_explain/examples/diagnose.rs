//! Which physical effect a model lacks: `cargo run -p whorl_explain --example diagnose [RUN_DIRECTORY...]`.

mod support;

use whorl_explain::diagnose;
use whorl_identification::Options;

fn main() -> anyhow::Result<()> {
    let material = support::Material::read()?;
    let found = diagnose(&material.case(), &Options::default(), &mut |_, _| {})?;
    println!("verdict: {:?}, effects: {:?}", found.diagnosis.verdict, found.diagnosis.effects);
    for sentence in found.answer() {
        println!("{sentence}");
    }
    if let Some(torque) = &found.torque {
        let largest = torque.before.states.iter().map(|state| state.torque_b_n_m.norm()).fold(0.0, f64::max);
        println!(
            "largest torque that the model does not explain in {}: {:.1} mN m",
            torque.run,
            1e3 * largest
        );
    }
    Ok(())
}
