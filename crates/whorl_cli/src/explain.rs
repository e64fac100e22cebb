//! Arguments shared by the commands that explain data, and the case built from them.

use std::path::PathBuf;

use anyhow::bail;
use serde::Serialize;
use whorl_commands::options;
use whorl_commands::settings::read;
use whorl_dynamics::effects::find;
use whorl_identification::{Options, Settings};

use crate::effects::unknown;
use crate::runs::{OutputArguments, RunArguments};

/// Runs to explain, and output files for the answer.
#[derive(Debug, clap::Args)]
pub struct ExplainArguments {
    #[command(flatten)]
    pub runs: RunArguments,
    #[command(flatten)]
    output: OutputArguments,
}

impl ExplainArguments {
    /// Writes the JSON that `value` returns, if requested.
    pub fn write_json<T: Serialize>(&self, value: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<()> {
        self.output.write_json(value)
    }

    /// Writes the page and returns its path.
    pub fn write_page(&self, name: &str, html: &str) -> anyhow::Result<PathBuf> {
        self.output.write_page(&self.runs, name, html)
    }
}

/// Options of the search for effects.
#[derive(Debug, clap::Args)]
pub struct SearchArguments {
    /// Effect to exclude, by its id; may be given several times.
    #[arg(long, value_name = "EFFECT")]
    exclude: Vec<String>,
    /// For experts: other numbers than those that `whorl diagnose --settings` prints, in a file of that form.
    #[arg(long, value_name = "FILE", hide = true)]
    settings_file: Option<PathBuf>,
}

impl SearchArguments {
    /// Options of the search, on all processors; only effects that there are can be left out.
    pub fn options(&self) -> anyhow::Result<Options> {
        if let Some(id) = self.exclude.iter().find(|id| find(id).is_none()) {
            bail!("--exclude: {}", unknown(id));
        }
        let settings = self.settings()?;
        Ok(Options { exclude: self.exclude.clone(), settings, ..options() })
    }

    /// Numbers that the verdict depends on.
    pub fn settings(&self) -> anyhow::Result<Settings> {
        self.settings_file.as_deref().map_or_else(|| Ok(Settings::default()), read)
    }
}
