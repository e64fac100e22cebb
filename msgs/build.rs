//! Makes the Rust types, the table of definitions and the list of messages from the `.msg` and `.srv` files.
//!
//! All files in `msg/`, `srv/` and `standard/PACKAGE/` are used when the crate is built: no list repeats
//! their names.

#[path = "build/generate.rs"]
mod generate;
#[path = "build/parse.rs"]
mod parse;

use std::error::Error;
use std::path::{Path, PathBuf};

use parse::{Definition, Service};

/// The package whose files lie in `msg/` and `srv/`.
const OWN_PACKAGE: &str = "whorl_msgs";

fn main() -> Result<(), Box<dyn Error>> {
    let root = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR")?);
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    for watched in ["msg", "srv", "standard", "build", "build.rs"] {
        println!("cargo::rerun-if-changed={watched}");
    }
    let mut definitions = Vec::new();
    for package in sorted_entries(&root.join("standard"))?.iter().filter(|path| path.is_dir()) {
        definitions.extend(read_package(package, &stem(package))?);
    }
    definitions.extend(read_package(&root.join("msg"), OWN_PACKAGE)?);
    let services = sorted_entries(&root.join("srv"))?
        .iter()
        .filter(|path| has_extension(path, "srv"))
        .map(|path| {
            let text = std::fs::read_to_string(path)?;
            Service::parse(OWN_PACKAGE, &stem(path), &text).map_err(|error| at(path, &error))
        })
        .collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    std::fs::write(out.join("packages.rs"), generate::packages(&definitions, &services)?)?;
    std::fs::write(out.join("definitions.rs"), generate::table(&definitions))?;
    std::fs::write(out.join("messages.rs"), generate::messages(&definitions)?)?;
    Ok(())
}

/// Every `.msg` file of a folder, in alphabetical order.
fn read_package(folder: &Path, package: &str) -> Result<Vec<Definition>, Box<dyn Error>> {
    sorted_entries(folder)?
        .iter()
        .filter(|path| has_extension(path, "msg"))
        .map(|path| {
            let text = std::fs::read_to_string(path)?;
            let mut definition =
                Definition::parse(package, &stem(path), &text).map_err(|error| at(path, &error))?;
            definition.path = path.clone();
            Ok(definition)
        })
        .collect()
}

fn sorted_entries(folder: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let entries = std::fs::read_dir(folder).map_err(|error| at(folder, &error.to_string()))?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    paths.sort();
    Ok(paths)
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension == wanted)
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

fn at(path: &Path, problem: &str) -> Box<dyn Error> {
    format!("{}: {problem}", path.display()).into()
}
