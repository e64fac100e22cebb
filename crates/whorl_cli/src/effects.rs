//! `whorl effects`: the catalogue of physical effects.

use std::path::PathBuf;

use anyhow::bail;
use whorl_dynamics::effects::{catalogue, describe, find};
use whorl_dynamics::{Effect, PlatformModel};
use whorl_recording::read_model;

use crate::table::print;

/// Arguments of `whorl effects`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Effects to explain; without any, all are listed.
    #[arg(value_name = "ID")]
    ids: Vec<String>,
    /// Explains all effects.
    #[arg(long, conflicts_with = "ids")]
    all: bool,
    /// Parameter file of the platform, for the names of wheels and jets [default: Whorl-I as published].
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

/// Carries out `whorl effects`.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let model = match &arguments.model {
        Some(path) => read_model(path, None)?.model,
        None => PlatformModel::whorl_1_reference(),
    };
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
            Some(effect) => wanted.push(effect),
            None => bail!("there is no effect {id}; {}", hint(id)),
        }
    }
    let texts: Vec<String> = wanted.iter().map(|effect| describe(*effect, &model)).collect();
    print!("{}", texts.join("\n"));
    Ok(())
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
