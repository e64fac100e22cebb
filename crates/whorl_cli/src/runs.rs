//! Runs and their model: arguments that several commands share.

use std::path::{Path, PathBuf};

use crate::output::{JsonArgument, tell};

use whorl_commands::page::NewPage;
pub use whorl_commands::page::{link_pages_beside, page_of};
pub use whorl_commands::runs::{RunSources, Runs, write};

/// Runs, with the options for reading and testing them.
#[derive(Debug, Clone, clap::Args)]
pub struct RunArguments {
    /// Run directories, rosbag2 directories, .mcap files, or CSV files with --channels.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    #[command(flatten)]
    pub context: RunContext,
}

/// Options for reading and testing runs.
#[derive(Debug, Clone, clap::Args)]
pub struct RunContext {
    /// Held-out run: used to test, never to fit; may be given several times.
    #[arg(long, value_name = "RUN")]
    pub held_out: Vec<PathBuf>,
    /// The platform's parameter file [default: the parameters saved in the first run].
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Name of the platform, where runs or parameters hold several.
    #[arg(long, value_name = "NAME")]
    pub platform: Option<String>,
    /// Map of topics or columns, for runs that Whorl did not record.
    #[arg(long, value_name = "FILE")]
    pub channels: Option<PathBuf>,
}

impl RunArguments {
    /// Where they are.
    pub fn sources(&self) -> RunSources {
        let RunContext { held_out, model, platform, channels } = self.context.clone();
        RunSources { runs: self.runs.clone(), held_out, model, platform, channels }
    }

    /// Reads everything.
    pub fn read(&self) -> anyhow::Result<Runs> {
        self.sources().read()
    }
}

/// Output files for the answer.
#[derive(Debug, Clone, clap::Args)]
pub struct OutputArguments {
    #[command(flatten)]
    json: JsonArgument,
    /// Path of the HTML page [default: in the first run's directory, or beside its file and named by it].
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

impl OutputArguments {
    /// Writes the JSON that `value` returns, if requested.
    pub fn write_json<T: serde::Serialize>(
        &self,
        value: impl FnOnce() -> anyhow::Result<T>,
    ) -> anyhow::Result<()> {
        self.json.write(value)
    }

    /// Writes the page to `--html`, else where [`page_of`] says; in the working directory where nothing can be written. Returns the path.
    pub fn write_page(&self, runs: &RunArguments, name: &str, html: &str) -> anyhow::Result<PathBuf> {
        let first = runs.runs.first().map_or(Path::new(""), PathBuf::as_path);
        let page = NewPage::create(first, name, self.html.as_deref(), Path::new(""))?;
        if let Some(why) = &page.moved {
            tell(format_args!("warning: {why}: the page is in the working directory"));
        }
        page.finish(html)
    }
}
