//! What `whorl run` and its relatives are told.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use whorl_launch::{Backend, DriverSource, RealTime, Setup, SetupOptions};

use crate::output::JsonArgument;
#[derive(Debug, Args)]
pub struct Arguments {
    /// A name in params/experiments/, or a file.
    pub(super) experiment: Option<String>,
    /// Platforms, e.g. "whorl_1 whorl_2" [default: those of the parameter files].
    #[arg(long, value_name = "\"A B\"", value_parser = names)]
    pub(super) platforms: Option<Names>,
    /// Backend of the drivers, for one platform or all: sim, replay or hardware [default: sim].
    #[arg(long, value_name = "[PLATFORM=]KIND", value_parser = backend)]
    pub(super) backend: Vec<(Option<String>, Backend)>,
    /// Recording for a platform with the replay backend: run, bag or CSV.
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = of_platform)]
    pub(super) source: Vec<(String, PathBuf)>,
    /// Map of the columns of a CSV recording, such as params/channels/broad.yaml.
    #[arg(long, value_name = "PLATFORM=FILE", value_parser = of_platform)]
    pub(super) channels: Vec<(String, PathBuf)>,
    /// Folder of run directories [default: runs/].
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Seed of the simulated hardware.
    #[arg(long, default_value_t = 1)]
    pub(super) seed: u64,
    /// Shows the run in a browser, at the address that is printed.
    #[arg(long)]
    pub(super) live: bool,
    /// Port of the live page; 0: any free one.
    #[arg(long, default_value_t = crate::live::PORT, requires = "live")]
    pub(super) live_port: u16,
    /// Authenticate and encrypt all traffic (SROS2), with the keys in ROS_SECURITY_KEYSTORE or, where that is not set,
    /// with new ones for this domain; nobody without keys takes part. Needs programs built with `--features security`.
    #[arg(long)]
    pub(super) secure: bool,
    #[command(flatten)]
    pub(super) scheduling: Scheduling,
    #[command(flatten)]
    pub(super) json: JsonArgument,
    #[command(flatten)]
    pub(super) folders: Folders,
}

/// How the operating system is to treat the nodes.
#[derive(Debug, Args)]
pub struct Scheduling {
    /// Real-time priority (SCHED_FIFO) and memory kept in RAM for drivers, estimators, local controls and the coordinator:
    /// for a computer that other programs load as well. `whorl doctor` says whether this user may.
    #[arg(long)]
    realtime: bool,
    /// Processors for these nodes, e.g. 2,3 [default: all].
    #[arg(long, value_name = "N,N", value_delimiter = ',', requires = "realtime")]
    cpus: Vec<usize>,
}

impl Scheduling {
    /// What was asked for, if the operating system allows it.
    pub fn real_time(&self) -> anyhow::Result<Option<RealTime>> {
        Ok(self.realtime.then(|| RealTime::on(self.cpus.clone())).transpose()?)
    }
}

/// Where parameters are.
#[derive(Debug, Args)]
pub struct Folders {
    /// Parameter folder [default: params/].
    #[arg(long, value_name = "DIR")]
    pub(super) params: Option<PathBuf>,
    /// Folder of params/ and runs/; the run records its git commit.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub(super) root: PathBuf,
}

/// What commands about one platform are told besides its name.
#[derive(Debug, Args)]
pub struct AboutPlatform {
    /// Experiment whose platforms it is one of: a name in params/experiments/, or a file.
    #[arg(long, value_name = "NAME|FILE", default_value = "hold")]
    experiment: String,
    #[command(flatten)]
    pub json: JsonArgument,
    #[command(flatten)]
    pub folders: Folders,
}

impl AboutPlatform {
    /// The experiment and its files.
    pub fn options(&self) -> SetupOptions {
        self.folders.options(&self.experiment)
    }
}

impl Folders {
    /// Options of the launch.
    pub fn options(&self, experiment: &str) -> SetupOptions {
        let params_of_whorl = self.root.join("params");
        SetupOptions {
            experiment: experiment.to_owned(),
            params: self.params.clone().unwrap_or_else(|| params_of_whorl.clone()),
            params_of_whorl,
            ..SetupOptions::default()
        }
    }

    /// Where runs are recorded.
    pub fn recordings(&self) -> PathBuf {
        self.root.join("runs")
    }

    /// Creates the directory of a new run.
    pub fn new_run(&self, out: Option<&Path>, setup: &Setup) -> anyhow::Result<PathBuf> {
        let runs = out.map_or_else(|| self.root.join("runs"), Path::to_owned);
        // Nodes are told by parameters, which are texts.
        if runs.to_str().is_none() {
            anyhow::bail!("{}: a folder of runs needs a name in UTF-8", runs.display());
        }
        Ok(whorl_bag::new_run_directory(&runs, &setup.experiment_name(), whorl_ros::wall_clock())?)
    }
}

/// Names of platforms in one argument.
#[derive(Debug, Clone)]
pub struct Names(pub Vec<String>);

/// Reads `"A B"`.
pub fn names(text: &str) -> Result<Names, String> {
    let names: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
    if names.is_empty() { Err("it names no platform".to_owned()) } else { Ok(Names(names)) }
}

fn backend(text: &str) -> Result<(Option<String>, Backend), String> {
    match text.split_once('=') {
        Some((platform, kind)) => Ok((Some(platform.to_owned()), kind.parse()?)),
        None => Ok((None, text.parse()?)),
    }
}

fn of_platform(text: &str) -> Result<(String, PathBuf), String> {
    let (platform, file) = text.split_once('=').ok_or("it takes PLATFORM=FILE")?;
    Ok((platform.to_owned(), PathBuf::from(file)))
}

impl Arguments {
    /// Options of the launch.
    pub fn options(&self, experiment: &str) -> SetupOptions {
        let mut options = self.folders.options(experiment);
        options.seed = self.seed;
        options.platforms = self.platforms.clone().map(|Names(names)| names);
        let mut drivers = BTreeMap::<String, DriverSource>::new();
        let mut of_all = Backend::default();
        for (platform, backend) in &self.backend {
            match platform {
                Some(platform) => drivers.entry(platform.clone()).or_default().backend = *backend,
                None => of_all = *backend,
            }
        }
        for (platform, file) in &self.source {
            drivers.entry(platform.clone()).or_default().source = Some(file.clone());
        }
        for (platform, file) in &self.channels {
            drivers.entry(platform.clone()).or_default().channels = Some(file.clone());
        }
        let named = |platform: &String| self.backend.iter().any(|(p, _)| p.as_ref() == Some(platform));
        for (_, driver) in drivers.iter_mut().filter(|(platform, _)| !named(platform)) {
            driver.backend = of_all;
        }
        options.drivers = drivers;
        options.backend_of_others = of_all;
        options
    }
}
