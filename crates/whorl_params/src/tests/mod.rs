//! Tests of the crate as a whole.

mod changes;
mod damaged_files;
mod editing;
mod errors;
mod freedom;
mod history;
mod layering;
mod platform_errors;
mod platform_files;
mod priors;
mod yaml_forms;

use std::path::PathBuf;

use crate::{NodeParameters, ParameterTree, Reader};

/// The parameters of `/whorl_1/estimator` from one file `p.yaml`, whose section of that name holds
/// these lines, which start on line 3.
fn estimator(lines: &str) -> NodeParameters {
    let indented: String = lines.lines().map(|line| format!("    {line}\n")).collect();
    tree(&format!("/whorl_1/estimator:\n  ros__parameters:\n{indented}")).for_node("/whorl_1/estimator")
}

fn tree(text: &str) -> ParameterTree {
    ParameterTree::from_texts(&[("p.yaml", text)], &[]).unwrap()
}

/// What loading this text complains about.
fn load_error(text: &str) -> String {
    ParameterTree::from_texts(&[("p.yaml", text)], &[]).unwrap_err().to_string()
}

/// What reading these parameters complains about.
fn read_error<T>(parameters: &NodeParameters, read: impl FnOnce(&mut Reader<'_>) -> T) -> String {
    crate::read(parameters, |r| {
        read(r);
    })
    .unwrap_err()
    .to_string()
}

/// The parameter files of the repository.
fn params_directory() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../params"))
}
