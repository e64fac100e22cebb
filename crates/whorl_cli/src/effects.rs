//! `whorl effects`: the catalogue of physical effects.

use std::path::{Path, PathBuf};

use anyhow::bail;
use whorl_dynamics::effects::written::{FUNCTIONS, QUANTITIES, QuantityForm};
use whorl_dynamics::effects::{catalogue, describe, find};
use whorl_dynamics::{Effect, PlatformModel};
use whorl_params::load_effect;
use whorl_recording::read_model;

use crate::table::print;

/// Arguments of `whorl effects`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Effects to explain, or files of effects (NAME.yaml) to check and explain; without any, all are listed.
    #[arg(value_name = "ID|FILE")]
    ids: Vec<String>,
    /// Explains all effects.
    #[arg(long, conflicts_with = "ids")]
    all: bool,
    /// Lists the quantities and functions that the equation of an effect's file may name.
    #[arg(long, conflicts_with_all = ["ids", "all"])]
    quantities: bool,
    /// Parameter file of the platform, for the names of wheels and jets and the effects beside it [default: Whorl-I as published].
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

/// Carries out `whorl effects`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let model = match &arguments.model {
        Some(path) => read_model(path, None)?.model,
        None => PlatformModel::whorl_1_reference(),
    };
    if arguments.quantities {
        quantities();
        return Ok(());
    }
    if arguments.ids.is_empty() && !arguments.all {
        list(&model);
        return Ok(());
    }
    let mut wanted: Vec<&dyn Effect> = Vec::new();
    if arguments.all {
        wanted.extend(catalogue());
    }
    for id in &arguments.ids {
        match find(id) {
            _ if is_effect_file(id) => wanted.push(load_effect(Path::new(id))?),
            Some(effect) => wanted.push(effect),
            None => bail!("there is no effect {id}; {}", hint(id)),
        }
    }
    let texts: Vec<String> = wanted.iter().map(|effect| describe(*effect, &model)).collect();
    print!("{}", texts.join("\n"));
    Ok(())
}

/// Whether an argument is the file of an effect and not an id.
pub fn is_effect_file(argument: &str) -> bool {
    Path::new(argument).extension().is_some_and(|extension| extension == "yaml" || extension == "yml")
}

fn quantities() {
    let rows: Vec<Vec<String>> = QUANTITIES
        .iter()
        .map(|quantity| {
            let written = match quantity.form {
                QuantityForm::Scalar => quantity.name.to_owned(),
                QuantityForm::Vector => format!("{0}, {0}.x", quantity.name),
                QuantityForm::Indexed => format!("{}[1]", quantity.name),
            };
            vec![written, quantity.unit.to_owned(), quantity.meaning.to_owned()]
        })
        .collect();
    print(&["quantity", "unit", "what it is"].map(str::to_owned), &rows);
    println!("\nVectors are in body axes.\n");
    let rows: Vec<Vec<String>> =
        FUNCTIONS.iter().map(|(form, gives)| vec![(*form).to_owned(), (*gives).to_owned()]).collect();
    print(&["function", "what it gives"].map(str::to_owned), &rows);
    println!(
        "\nNumbers may have a unit: 0.1 [rad/s]. Operators: + - * / ^. docs/adding_an_effect.md shows a file of an effect."
    );
}

/// Effects whose ids share a word with the requested one.
fn hint(id: &str) -> String {
    let words: Vec<&str> = id.split('_').filter(|w| w.len() > 2).collect();
    let alike: Vec<&str> = catalogue()
        .iter()
        .map(|e| e.info().id)
        .filter(|known| words.iter().any(|w| known.contains(w)))
        .collect();
    if alike.is_empty() {
        "`whorl effects` lists them".to_owned()
    } else {
        format!("did you mean {}?", alike.join(" or "))
    }
}

fn list(model: &PlatformModel) {
    let rows: Vec<Vec<String>> = catalogue()
        .iter()
        .map(|effect| {
            let info = effect.info();
            let parameters = effect.parameters(model);
            let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
            let shown = match names.as_slice() {
                [a, b, c, rest @ ..] if rest.len() > 1 => format!("{a}, {b}, {c} and {} more", rest.len()),
                all => all.join(", "),
            };
            vec![info.id.to_owned(), info.kind.to_string(), info.title.to_owned(), shown]
        })
        .collect();
    print(&["id", "kind", "what it is", "parameters"].map(str::to_owned), &rows);
    println!("\n`whorl effects ID` explains one: equation, source, parameters, what it is confused with.");
}
