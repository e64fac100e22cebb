//! Which experiment, platforms and files; checked before anything starts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use whorl_node::{Node, node_set};
use whorl_params::{Formation, ParameterTree};

use crate::error::LaunchError;
use crate::process::{Arguments, Process};

/// What a driver drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// Simulated hardware.
    #[default]
    Sim,
    /// A recording.
    Replay,
    /// The platform.
    Hardware,
}

impl Backend {
    /// As the driver's parameter `backend`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Replay => "replay",
            Self::Hardware => "hardware",
        }
    }
}

impl FromStr for Backend {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Sim, Self::Replay, Self::Hardware]
            .into_iter()
            .find(|backend| backend.name() == text)
            .ok_or_else(|| format!("backend '{text}' is not sim, replay or hardware"))
    }
}

/// Arguments of one driver besides its parameter files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DriverSource {
    /// What it drives.
    pub backend: Backend,
    /// Recording to replay: run, bag or CSV.
    pub source: Option<PathBuf>,
    /// Column map of a CSV recording.
    pub channels: Option<PathBuf>,
    /// Folder in which emulators have the devices of [`Backend::Hardware`]; `None`: they are real.
    pub emulated: Option<PathBuf>,
}

/// What the user asked for.
#[derive(Debug, Clone, Default)]
pub struct SetupOptions {
    /// Name in the parameter folder, or a file; empty is an error that lists the names.
    pub experiment: String,
    /// Parameter folder.
    pub params: PathBuf,
    /// Parameter folder in which an experiment is looked for that is not in `params`.
    pub params_of_whorl: PathBuf,
    /// Platforms; `None`: those that the parameter files name.
    pub platforms: Option<Vec<String>>,
    /// Backends of individual platforms.
    pub drivers: BTreeMap<String, DriverSource>,
    /// Backend of all other platforms.
    pub backend_of_others: Backend,
    /// Seed of the simulated hardware.
    pub seed: u64,
}

/// A checked setup: every file exists, every platform is known, every section matches a node.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The experiment's file.
    pub experiment: PathBuf,
    /// Names of the platforms.
    pub platforms: Vec<String>,
    params: PathBuf,
    drivers: BTreeMap<String, DriverSource>,
    backend_of_others: Backend,
    seed: u64,
    law_on_platforms: bool,
    emulated: BTreeMap<String, PathBuf>,
}

impl Setup {
    /// Finds the files and checks everything that can be checked before a start. Types and ranges of parameters are checked
    /// by the nodes that read them.
    ///
    /// # Errors
    /// Missing files or platforms; parameter files that do not load; sections that match no node.
    pub fn new(options: SetupOptions) -> Result<Self, LaunchError> {
        let SetupOptions { experiment, params, params_of_whorl, platforms, drivers, backend_of_others, seed } =
            options;
        let experiment = find_experiment(&experiment, &[&params, &params_of_whorl])?;
        let common = [params.join("common.yaml"), experiment.clone()];
        let Formation { platforms: in_files } = ParameterTree::load(&common, &[])?.formation();
        let platforms = platforms.unwrap_or_else(|| in_files.clone());
        if let Some(name) = drivers.keys().find(|name| !platforms.contains(name)) {
            return Err(LaunchError::UnknownPlatform { name: name.clone(), platforms });
        }
        let mut files = vec![params.join("common.yaml")];
        for platform in &platforms {
            let file = params.join(format!("{platform}.yaml"));
            if !file.is_file() {
                return Err(LaunchError::NoPlatform { platform: platform.clone(), file });
            }
            files.push(file);
            files.extend(truth_of(&params, platform));
        }
        files.push(experiment.clone());
        let tree = ParameterTree::load(&files, &[])?;
        let law_on_platforms = tree.law_on_platforms();
        // An experiment may have sections for a platform that is left out this time.
        let mut known = in_files;
        known.extend(platforms.iter().cloned());
        let nodes = node_set(&known, law_on_platforms);
        tree.check_sections(nodes.iter().map(|instance| instance.name.as_str()))?;
        Ok(Self {
            experiment,
            platforms,
            params,
            drivers,
            backend_of_others,
            seed,
            law_on_platforms,
            emulated: BTreeMap::new(),
        })
    }

    /// Name of the experiment's file.
    #[must_use]
    pub fn experiment_name(&self) -> String {
        self.experiment.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    /// The platforms whose drivers drive devices.
    #[must_use]
    pub fn on_hardware(&self) -> Vec<String> {
        let backend =
            |platform: &&String| self.drivers.get(*platform).map_or(self.backend_of_others, |d| d.backend);
        self.platforms.iter().filter(|platform| backend(platform) == Backend::Hardware).cloned().collect()
    }

    /// The devices of a platform are emulated, below this folder.
    pub fn emulate(&mut self, platform: &str, root: PathBuf) {
        self.emulated.insert(platform.to_owned(), root);
    }

    /// Parameter files of a platform's driver, the lowest layer first.
    #[must_use]
    pub fn driver_files(&self, platform: &str) -> Vec<PathBuf> {
        let own = [self.params.join("common.yaml"), self.params.join(format!("{platform}.yaml"))];
        let truth = truth_of(&self.params, platform);
        own.into_iter().chain(truth).chain([self.experiment.clone()]).collect()
    }

    /// Every process of an experiment: recorder, platforms, coordinator.
    #[must_use]
    pub fn everything(&self, run: &Path, git_commit: Option<&str>) -> Vec<Process> {
        let mut processes = vec![self.recorder(run, Some(self.seed), git_commit)];
        processes.extend(self.platforms.iter().flat_map(|platform| self.platform(platform)));
        processes.push(self.coordinator(&[]));
        processes
    }

    /// The nodes of one platform.
    #[must_use]
    pub fn platform(&self, platform: &str) -> Vec<Process> {
        let others = || DriverSource { backend: self.backend_of_others, ..DriverSource::default() };
        let driver = self.drivers.get(platform).cloned().unwrap_or_else(others);
        let emulated = driver.emulated.as_ref().or_else(|| self.emulated.get(platform));
        let emulated = emulated.filter(|_| driver.backend == Backend::Hardware);
        Node::of_platform(self.law_on_platforms)
            .map(|node| {
                let mut arguments = Arguments::default();
                arguments.namespace(platform);
                arguments.file(self.params.join("common.yaml"));
                arguments.file(self.params.join(format!("{platform}.yaml")));
                if node.info().reads_truth {
                    truth_of(&self.params, platform).into_iter().for_each(|file| arguments.file(file));
                }
                arguments.file(self.experiment.clone());
                if node == Node::Driver {
                    arguments.parameter("backend", driver.backend.name());
                    arguments.parameter("seed", self.seed);
                    for (key, path) in
                        [("replay.source", &driver.source), ("replay.channels", &driver.channels)]
                    {
                        path.iter().for_each(|path| arguments.parameter(key, path.display()));
                    }
                    emulated.iter().for_each(|root| arguments.parameter("hardware.root", root.display()));
                }
                Process { label: format!("{platform}_{}", node.name()), node, arguments: arguments.finish() }
            })
            .collect()
    }

    /// The formation's coordinator, with further parameters.
    #[must_use]
    pub fn coordinator(&self, parameters: &[(&str, &str)]) -> Process {
        let mut arguments = self.of_formation(false);
        parameters.iter().for_each(|(key, value)| arguments.parameter(key, value));
        Process {
            label: Node::Coordinator.name().to_owned(),
            node: Node::Coordinator,
            arguments: arguments.finish(),
        }
    }

    /// The recorder, into this run directory. It keeps all files with the run, including the truth of simulated
    /// hardware.
    #[must_use]
    pub fn recorder(&self, run: &Path, seed: Option<u64>, git_commit: Option<&str>) -> Process {
        let mut arguments = self.of_formation(true);
        arguments.parameter("run_directory", run.display());
        seed.iter().for_each(|seed| arguments.parameter("seed", seed));
        // Quoted: it may consist of digits only.
        git_commit.iter().for_each(|commit| arguments.parameter("git_commit", format!("'{commit}'")));
        Process {
            label: Node::Recorder.name().to_owned(),
            node: Node::Recorder,
            arguments: arguments.finish(),
        }
    }

    /// Arguments of nodes that need the files of all platforms.
    fn of_formation(&self, with_truth: bool) -> Arguments {
        let mut arguments = Arguments::default();
        arguments.file(self.params.join("common.yaml"));
        for platform in &self.platforms {
            arguments.file(self.params.join(format!("{platform}.yaml")));
            if with_truth {
                truth_of(&self.params, platform).into_iter().for_each(|file| arguments.file(file));
            }
        }
        arguments.file(self.experiment.clone());
        arguments.parameter("formation.platforms", format!("[{}]", self.platforms.join(",")));
        arguments
    }
}

fn truth_of(params: &Path, platform: &str) -> Option<PathBuf> {
    Some(params.join("truth").join(format!("{platform}.yaml"))).filter(|file| file.is_file())
}

/// The file of an experiment: of this path, else of this name in one of the parameter folders, the first of which has it.
///
/// # Errors
/// When there is none; with the names of those in the first folder.
pub fn find_experiment(name: &str, params: &[&Path]) -> Result<PathBuf, LaunchError> {
    let known = || params.first().map_or_else(Vec::new, |folder| experiments_in(&folder.join("experiments")));
    if name.is_empty() {
        return Err(LaunchError::NoName { known: known() });
    }
    let path = PathBuf::from(name);
    let file = format!("{name}.yaml");
    let in_folders = params.iter().map(|folder| folder.join("experiments").join(&file));
    if let Some(found) = std::iter::once(path.clone()).chain(in_folders).find(|path| path.is_file()) {
        return Ok(found);
    }
    // Only a path has a folder or the ending of a file.
    if path.components().count() > 1 || path.extension().is_some_and(|e| e == "yaml" || e == "yml") {
        return Err(LaunchError::NoFile(path));
    }
    Err(LaunchError::NoExperiment { name: name.to_owned(), known: known() })
}

/// Names of the experiments in a folder, in alphabetical order.
fn experiments_in(folder: &Path) -> Vec<String> {
    let paths = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let yaml = paths.filter(|path| path.extension().is_some_and(|extension| extension == "yaml"));
    let mut names: Vec<String> =
        yaml.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned())).collect();
    names.sort_unstable();
    names
}
