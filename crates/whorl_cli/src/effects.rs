//! `whorl effects`: the catalogue of physical effects.

use std::path::{Path, PathBuf};

use anyhow::bail;
use serde_json::{Value, json};
use whorl_dynamics::effects::written::{FUNCTIONS, QUANTITIES, QuantityForm};
use whorl_dynamics::effects::{ParameterSpec, catalogue, describe, find};
use whorl_dynamics::{Effect, PlatformModel};
use whorl_math::words::did_you_mean;
use whorl_params::load_effect;
use whorl_recording::read_model;

use crate::output::{JsonArgument, say, text};
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
    #[command(flatten)]
    json: JsonArgument,
}

/// Carries out `whorl effects`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let model = match &arguments.model {
        Some(path) => read_model(path, None)?.model,
        None => PlatformModel::whorl_1_reference(),
    };
    if arguments.quantities {
        quantities();
        let listed =
            || QUANTITIES.iter().map(|q| json!({"name": q.name, "unit": q.unit, "meaning": q.meaning}));
        return arguments.json.write(|| Ok(listed().collect::<Vec<_>>()));
    }
    if arguments.ids.is_empty() && !arguments.all {
        list(&model);
        let all = || catalogue().iter().map(|effect| as_json(*effect, &model)).collect::<Vec<_>>();
        return arguments.json.write(|| Ok(all()));
    }
    let mut wanted: Vec<&dyn Effect> = Vec::new();
    if arguments.all {
        wanted.extend(catalogue());
    }
    for id in &arguments.ids {
        match find(id) {
            _ if is_effect_file(id) => wanted.push(load_effect(Path::new(id))?),
            Some(effect) => wanted.push(effect),
            None => bail!(unknown(id)),
        }
    }
    let texts: Vec<String> = wanted.iter().map(|effect| describe(*effect, &model)).collect();
    text(&texts.join("\n"));
    arguments.json.write(|| Ok(wanted.iter().map(|effect| as_json(*effect, &model)).collect::<Vec<_>>()))
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
    say!("\nVectors are in body axes.\n");
    let rows: Vec<Vec<String>> =
        FUNCTIONS.iter().map(|(form, gives)| vec![(*form).to_owned(), (*gives).to_owned()]).collect();
    print(&["function", "what it gives"].map(str::to_owned), &rows);
    say!(
        "\nNumbers may have a unit: 0.1 [rad/s]. Operators: + - * / ^. docs/adding_an_effect.md shows a file of an effect."
    );
}

/// What is said of an id that no effect has.
pub fn unknown(id: &str) -> String {
    let likely = did_you_mean(id, catalogue().iter().map(|effect| effect.info().id));
    format!("there is no effect {id}; {}", likely.unwrap_or_else(|| "`whorl effects` lists them".to_owned()))
}

fn as_json(effect: &dyn Effect, model: &PlatformModel) -> Value {
    let info = effect.info();
    let parameter = |p: &ParameterSpec| json!({"name": p.name, "unit": p.unit, "min": p.min, "max": p.max, "meaning": p.doc});
    json!({
        "id": info.id,
        "kind": info.kind.to_string(),
        "title": info.title,
        "parameters": effect.parameters(model).iter().map(parameter).collect::<Vec<_>>(),
        "text": describe(effect, model),
    })
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
    say!("\n`whorl effects ID` explains one: equation, source, parameters, what it is confused with.");
}
