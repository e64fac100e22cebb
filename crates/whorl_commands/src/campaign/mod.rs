//! Campaigns: their plan from a file, their folder, their tables; over experiments or over recordings.

mod answers;
mod experiments;
mod recordings;

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use serde_json::Value;
use whorl_campaign::work::{Folder, Tasks};
use whorl_campaign::{Plan, definition, recordings as asked};
use whorl_params::{ParameterTree, try_read};

pub use recordings::RecordingPlan;

/// A campaign: a list of tasks.
#[derive(Debug, Clone)]
pub enum Campaign {
    /// Simulated runs.
    Experiments(Plan),
    /// One question to many recordings.
    Recordings(RecordingPlan),
}

/// The plan of a campaign file, checked; `params` is the parameter folder (`None`: the file's `../`), `seeds` replaces the
/// file's number of seeds.
///
/// # Errors
/// What is wrong with the file, or with runs that cannot begin.
pub fn planned(file: &Path, params: Option<&Path>, seeds: Option<u64>) -> anyhow::Result<Campaign> {
    if !file.is_file() {
        bail!("{} {}", file.display(), whorl_params::missing(file));
    }
    let tree = ParameterTree::load(&[file.to_owned()], &[])?;
    tree.check_sections(["/campaign"])?;
    let parameters = tree.for_node("/campaign");
    if parameters.get("recordings").is_some() {
        if seeds.is_some() {
            bail!("--seeds is for campaigns over experiments; {} is over recordings", file.display());
        }
        let (definition, _) = try_read(&parameters, |r| Some(asked::read(r)))?;
        let base = file.parent().unwrap_or(Path::new(""));
        return Ok(Campaign::Recordings(RecordingPlan::new(definition, base)?));
    }
    let folder = match params {
        Some(folder) => folder.to_owned(),
        None => file
            .parent()
            .and_then(Path::parent)
            .filter(|folder| folder.join("common.yaml").is_file())
            .map(Path::to_owned)
            .with_context(|| {
                format!(
                    "{} is not in a folder campaigns/ beside a common.yaml; name the parameter folder with --params",
                    file.display()
                )
            })?,
    };
    let (mut definition, _) = try_read(&parameters, |r| Some(definition::read(r)))?;
    if let Some(seeds) = seeds {
        if seeds == 0 {
            bail!("--seeds is 0; allowed: at least 1");
        }
        definition.seeds = seeds;
    }
    let plan = Plan::new(definition, &folder)?;
    plan.check()?;
    Ok(Campaign::Experiments(plan))
}

/// Files of a campaign's results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tables {
    /// All rows as CSV.
    pub csv: PathBuf,
    /// Folder with all rows as Parquet.
    pub parquet: PathBuf,
    /// Further tables, each a folder of Parquet files.
    pub further: Vec<PathBuf>,
    /// Page of percentiles, of campaigns over experiments.
    pub page: Option<PathBuf>,
    /// How many tasks are done.
    pub rows: usize,
    /// What came of them, in sentences.
    pub said: Vec<String>,
}

impl Campaign {
    /// Its folder, new or to go on.
    ///
    /// # Errors
    /// A folder that cannot be written, or that holds another campaign.
    pub fn open(&self, out: &Path) -> anyhow::Result<Folder> {
        let text = match self {
            Self::Experiments(plan) => experiments::fingerprint(plan)?,
            Self::Recordings(plan) => plan.fingerprint()?,
        };
        Folder::open(out, &text, self.ending()).with_context(|| format!("cannot use {}", out.display()))
    }

    /// Learns from the folder which tasks there are. Who holds the folder (`grow`) appends recordings that have been added.
    ///
    /// # Errors
    /// No recording at all; effects of a recording that cannot be loaded; the file system's.
    pub fn list(&mut self, folder: &Folder, grow: bool) -> anyhow::Result<()> {
        match self {
            Self::Experiments(_) => Ok(()),
            Self::Recordings(plan) => plan.list(folder, grow),
        }
    }

    /// Every task in a line.
    ///
    /// # Errors
    /// As [`Self::list`].
    pub fn lines(&self) -> anyhow::Result<Vec<String>> {
        match self {
            Self::Experiments(plan) => Ok(experiments::lines(plan)),
            Self::Recordings(plan) => plan.lines(),
        }
    }

    /// Every task as data.
    ///
    /// # Errors
    /// As [`Self::list`].
    pub fn as_json(&self) -> anyhow::Result<Vec<Value>> {
        match self {
            Self::Experiments(plan) => Ok(experiments::as_json(plan)),
            Self::Recordings(plan) => plan.as_json(),
        }
    }

    /// What its tasks are called.
    #[must_use]
    pub fn noun(&self) -> &'static str {
        match self {
            Self::Experiments(_) => "runs",
            Self::Recordings(_) => "recordings",
        }
    }

    /// Writes the tables of what is done into the campaign's folder.
    ///
    /// # Errors
    /// A row that cannot be read, a file that cannot be written.
    pub fn write_tables(&self, folder: &Folder) -> anyhow::Result<Tables> {
        let mut tables = match self {
            Self::Experiments(plan) => experiments::write_tables(folder, plan)?,
            Self::Recordings(plan) => plan.write_tables(folder)?,
        };
        folder.publish().context("cannot write the tables")?;
        let files = [&mut tables.csv, &mut tables.parquet].into_iter();
        for file in files.chain(&mut tables.further).chain(&mut tables.page) {
            *file = folder.told(file);
        }
        Ok(tables)
    }
}

impl Tasks for Campaign {
    fn len(&self) -> u64 {
        match self {
            Self::Experiments(plan) => Tasks::len(plan),
            Self::Recordings(plan) => plan.len(),
        }
    }

    fn ending(&self) -> &'static str {
        match self {
            Self::Experiments(plan) => plan.ending(),
            Self::Recordings(plan) => plan.ending(),
        }
    }

    fn compute(&self, folder: &Folder, index: u64) -> io::Result<String> {
        match self {
            Self::Experiments(plan) => plan.compute(folder, index),
            Self::Recordings(plan) => plan.compute(folder, index),
        }
    }
}
