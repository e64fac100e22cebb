//! In which regime a model fails: `cargo run -p whorl_explain --example locate [RUN_DIRECTORY...]`.

mod support;

use whorl_explain::locate;
use whorl_identification::Options;

fn main() -> anyhow::Result<()> {
    let material = support::Material::read()?;
    let found = locate(&material.case(), &Options::default(), &mut |_, _| {})?;
    for sentence in found.pooled.answer() {
        println!("{sentence}");
    }
    let of_motors = found.pooled.motors.iter().filter_map(|motor| motor.dependences.as_ref());
    for quantity in found.pooled.dependences.iter().chain(of_motors).flat_map(|of| of.ranked.iter().take(3)) {
        println!("  {}: {:.0} % of the excess", quantity.variable, 100.0 * quantity.share);
    }
    Ok(())
}
