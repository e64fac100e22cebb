//! What the commands that explain data share: their arguments, and the case that they make of them.

use std::path::PathBuf;

use serde::Serialize;
use whorl_diagnosis::Options;
use whorl_explain::Case;

use crate::runs::{OutputArguments, RunArguments, Runs};

/// Runs to explain, and where the answer goes besides the terminal.
#[derive(Debug, clap::Args)]
pub struct ExplainArguments {
    #[command(flatten)]
    pub runs: RunArguments,
    #[command(flatten)]
    output: OutputArguments,
}

impl ExplainArguments {
    /// Writes what `value` makes as JSON, if it was asked for.
    pub fn write_json<T: Serialize>(&self, value: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<()> {
        self.output.write_json(value)
    }

    /// Writes the page; says where.
    pub fn write_page(&self, name: &str, html: &str) -> anyhow::Result<PathBuf> {
        self.output.write_page(&self.runs, name, html)
    }
}

/// How effects are looked for.
#[derive(Debug, clap::Args)]
pub struct SearchArguments {
    /// An effect that is not to be considered, by its id; may be given several times.
    #[arg(long, value_name = "EFFECT")]
    exclude: Vec<String>,
}

impl SearchArguments {
    /// As the search takes them, on all processors.
    pub fn options(&self) -> Options {
        Options { exclude: self.exclude.clone(), ..options() }
    }
}

/// On all processors.
pub fn options() -> Options {
    Options {
        threads: std::thread::available_parallelism().map_or(2, std::num::NonZero::get),
        ..Options::default()
    }
}

impl Runs {
    /// What is explained.
    pub fn case(&self) -> Case<'_> {
        Case {
            training: &self.training,
            held_out: &self.held_out,
            model: &self.known.model,
            prior: &self.known.prior,
        }
    }
}
