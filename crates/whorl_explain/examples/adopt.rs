//! How much adopting an effect improves the model: `cargo run -p whorl_explain --example adopt [RUN_DIRECTORY...]`.

mod support;

use whorl_explain::{adopt, diagnose};
use whorl_identification::Options;

fn main() -> anyhow::Result<()> {
    let material = support::Material::read()?;
    let case = material.case();
    let found = diagnose(&case, &Options::default(), &mut |_, _| {})?;
    if found.diagnosis.effects.is_empty() {
        println!("no effect was named: there is nothing to adopt");
        return Ok(());
    }
    let adoption = adopt(&case, &[found.diagnosis.effects], &Options::default(), &mut |_, _| {})?;
    for sentence in adoption.answer() {
        println!("{sentence}");
    }
    match adoption.objection(&case) {
        Some(objection) => println!("not to be adopted: {objection}"),
        None => {
            for change in adoption.changes(&case, "this example") {
                println!("  {}: {:?}  # {}", change.key, change.value, change.comment);
            }
        }
    }
    Ok(())
}
