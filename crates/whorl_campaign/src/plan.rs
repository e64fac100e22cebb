//! Every run that follows from a definition.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;
use whorl_params::{Override, ParameterErrors, layers_of_experiment, missing};

use crate::definition::{Axis, Definition};
use crate::row::{Row, parse_row, row_text};
use crate::run_spec::RunSpec;
use crate::single::{check, simulate};
use crate::work::{Folder, Tasks};

/// More runs than this are refused as a mistake.
const MOST_RUNS: u64 = 10_000_000;

/// Number of combinations that are checked before a campaign begins.
const MOST_CHECKED: u64 = 300;
/// Largest number of refused combinations to report.
const MOST_TOLD: usize = 3;

/// All runs, in the order of the table.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The definition.
    pub definition: Definition,
    /// Experiment files with the parameter files below them.
    layers: Vec<Vec<PathBuf>>,
    always: Vec<Override>,
    /// Parsed overrides of every choice of every axis.
    overrides: Vec<Vec<Vec<Override>>>,
    runs: u64,
}

/// Model monitors take as long as all else in a simulation; a campaign that asks for them overrides this.
const UNWATCHED: &str = "/**/model_monitor:enabled:=false";

/// A campaign that cannot be planned.
#[derive(Debug, Error)]
pub enum PlanError {
    /// An experiment file does not exist.
    #[error("experiments: {name}: {} {}", file.display(), missing(file))]
    NoExperiment {
        /// As the campaign names it.
        name: String,
        /// Where it is looked for.
        file: PathBuf,
    },
    /// Invalid parameters or overrides.
    #[error(transparent)]
    Parameters(#[from] ParameterErrors),
    /// An invalid override.
    #[error("sweep.{axis}: {problem}")]
    Override {
        /// Which axis.
        axis: String,
        /// What is wrong.
        problem: String,
    },
    /// Runs whose parameters are refused.
    #[error("runs that cannot begin:\n{0}")]
    Refused(String),
    /// Too many runs.
    #[error("{0} runs: at most {MOST_RUNS} in one campaign")]
    TooMany(u128),
}

impl Plan {
    /// From a definition and the parameter folder.
    ///
    /// # Errors
    /// Missing files, parameters that cannot be loaded, invalid overrides.
    pub fn new(definition: Definition, parameters: &Path) -> Result<Self, PlanError> {
        let mut layers = Vec::with_capacity(definition.experiments.len());
        for name in &definition.experiments {
            let file = parameters.join("experiments").join(format!("{name}.yaml"));
            if !file.is_file() {
                return Err(PlanError::NoExperiment { name: name.clone(), file });
            }
            layers.push(layers_of_experiment(parameters, &file)?);
        }
        let parse = |axis: &str, text: &String| {
            Override::parse(text)
                .map_err(|e| PlanError::Override { axis: axis.to_owned(), problem: e.to_string() })
        };
        let unwatched = UNWATCHED.to_owned();
        let always = std::iter::once(&unwatched).chain(&definition.always);
        let always = always.map(|o| parse("always", o)).collect::<Result<_, _>>()?;
        let of_axis = |axis: &Axis| -> Result<Vec<Vec<Override>>, PlanError> {
            let choice =
                |c: &crate::definition::Choice| c.overrides.iter().map(|o| parse(&axis.name, o)).collect();
            axis.choices.iter().map(choice).collect()
        };
        let overrides = definition.axes.iter().map(of_axis).collect::<Result<_, _>>()?;
        let combinations: u128 = definition.axes.iter().map(|a| a.choices.len() as u128).product();
        let runs = definition.experiments.len() as u128 * combinations * u128::from(definition.seeds);
        let runs = u64::try_from(runs).ok().filter(|n| *n <= MOST_RUNS).ok_or(PlanError::TooMany(runs))?;
        Ok(Self { definition, layers, always, overrides, runs })
    }

    /// Finished rows, in the order of runs.
    ///
    /// # Errors
    /// The file system's, or a row that cannot be read.
    pub fn rows(&self, folder: &Folder) -> io::Result<Vec<Row>> {
        folder.rows(self.runs, |_, text| parse_row(text, self.definition.axes.len()))
    }

    /// Whether every combination can begin: the first run of each is checked, or of as many as can be checked in
    /// a few seconds.
    ///
    /// # Errors
    /// The first combinations that cannot, and why.
    pub fn check(&self) -> Result<(), PlanError> {
        let seeds = self.definition.seeds.max(1);
        let combinations = self.runs / seeds;
        let every = combinations.div_ceil(MOST_CHECKED).max(1);
        let firsts = (0..combinations).step_by(usize::try_from(every).unwrap_or(usize::MAX));
        let specs = firsts.filter_map(|k| self.run(k * seeds));
        let mut problems: Vec<String> = Vec::new();
        for spec in specs {
            let Err(reason) = check(&spec) else { continue };
            if !problems.iter().any(|known| known.ends_with(&reason)) {
                problems.push(format!("{} {}: {reason}", spec.experiment, spec.labels.join(", ")));
            }
            if problems.len() == MOST_TOLD {
                break;
            }
        }
        if problems.is_empty() { Ok(()) } else { Err(PlanError::Refused(problems.join("\n"))) }
    }

    /// The run with this number: seeds change fastest, experiments slowest.
    #[must_use]
    pub fn run(&self, index: u64) -> Option<RunSpec> {
        if index >= self.runs {
            return None;
        }
        let mut rest = index;
        let mut digit = |base: u64| {
            let value = rest % base.max(1);
            rest /= base.max(1);
            value
        };
        let seed = self.definition.first_seed + digit(self.definition.seeds);
        let mut labels = vec![String::new(); self.definition.axes.len()];
        let mut chosen = vec![0; self.definition.axes.len()];
        for (k, axis) in self.definition.axes.iter().enumerate().rev() {
            chosen[k] = usize::try_from(digit(axis.choices.len() as u64)).ok()?;
            labels[k].clone_from(&axis.choices.get(chosen[k])?.label);
        }
        let experiment = usize::try_from(digit(self.definition.experiments.len() as u64)).ok()?;
        let mut overrides = self.always.clone();
        for (k, choice) in chosen.iter().enumerate() {
            overrides.extend(self.overrides.get(k)?.get(*choice)?.iter().cloned());
        }
        Some(RunSpec {
            index,
            experiment: self.definition.experiments.get(experiment)?.clone(),
            seed,
            labels,
            layers: self.layers.get(experiment)?.clone(),
            overrides,
        })
    }
}

impl Tasks for Plan {
    fn len(&self) -> u64 {
        self.runs
    }

    fn ending(&self) -> &'static str {
        "csv"
    }

    /// Simulates a run.
    fn compute(&self, folder: &Folder, index: u64) -> io::Result<String> {
        let spec = self.run(index).ok_or_else(|| io::Error::other(format!("there is no run {index}")))?;
        let kept = self.definition.keep_every > 0 && index.is_multiple_of(self.definition.keep_every);
        let keep = kept.then(|| folder.run_path(index));
        if let Some(begun) = keep.as_deref().filter(|path| path.exists()) {
            // Of a worker that was interrupted: it has no row.
            std::fs::remove_dir_all(begun)?;
        }
        Ok(row_text(&simulate(&spec, self.definition.longest_s, keep.as_deref())))
    }
}
