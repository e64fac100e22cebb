//! Why something cannot be started.

use std::path::PathBuf;

use thiserror::Error;
use whorl_params::ParameterErrors;

/// Why something cannot be started.
#[derive(Debug, Error)]
pub enum LaunchError {
    /// Nothing was asked for.
    #[error("name an experiment: {}, or a file", known.join(" "))]
    NoName {
        /// Names of the existing experiments.
        known: Vec<String>,
    },
    /// Not a file, and not in the parameter folder.
    #[error("no experiment '{name}': not a file, and {}{}", among(known), likely(name, known))]
    NoExperiment {
        /// What was asked for.
        name: String,
        /// Names of the existing experiments.
        known: Vec<String>,
    },
    /// A path at which there is no file.
    #[error("{} {}", .0.display(), whorl_params::missing(.0))]
    NoFile(PathBuf),
    /// A platform without a file.
    #[error("no parameter file for platform '{platform}': {} {}", file.display(), whorl_params::missing(file))]
    NoPlatform {
        /// The platform.
        platform: String,
        /// The file that is not there.
        file: PathBuf,
    },
    /// A platform that is not started.
    #[error("no platform '{name}' among: {}{}", platforms.join(" "), likely(name, platforms))]
    UnknownPlatform {
        /// The platform.
        name: String,
        /// Those that are started.
        platforms: Vec<String>,
    },
    /// Parameter files are wrong.
    #[error(transparent)]
    Parameters(#[from] ParameterErrors),
    /// A program that has not been built.
    #[error("{} is not there: build with 'cargo build --release', or run without --no-build", .0.display())]
    NoProgram(PathBuf),
    /// The domain is taken.
    #[error(
        "ROS domain {domain} is in use on this machine by {by}: end it (launch_scripts/stop_all.sh), or choose \
         another domain with ROS_DOMAIN_ID"
    )]
    DomainTaken {
        /// Its number.
        domain: u16,
        /// What uses it.
        by: String,
    },
    /// The folder for the processes of this user was made by somebody else.
    #[error(
        "{} {why}: nothing is written there. Remove it, or set XDG_RUNTIME_DIR to a folder that only you may write to",
        path.display()
    )]
    ForeignFolder {
        /// The folder.
        path: PathBuf,
        /// Why it is not trusted.
        why: String,
    },
    /// This user may not have real-time priority.
    #[error(
        "real-time priority is refused ({0}): write `@dialout - rtprio 80` into /etc/security/limits.d/whorl.conf and log \
         in again as a member of that group, or start without --realtime"
    )]
    RealTime(std::io::Error),
    /// This user may not keep memory from being moved to disk.
    #[error(
        "memory may not be kept in RAM, which --realtime needs: write `@dialout - memlock unlimited` into \
         /etc/security/limits.d/whorl.conf and log in again as a member of that group, or start without --realtime"
    )]
    MemoryLock,
    /// Processors that are not there, or not for this user.
    #[error("--cpus {}: {source}; /proc/cpuinfo lists the processors of this computer", listed(cpus))]
    Processors {
        /// Their numbers.
        cpus: Vec<usize>,
        /// Why not.
        source: std::io::Error,
    },
    /// The operating system refuses.
    #[error("{what} {}: {source}", path.display())]
    Io {
        /// What was tried.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

impl LaunchError {
    /// For `map_err`.
    pub(crate) fn io(what: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { what, path, source }
    }
}

fn likely(name: &str, known: &[String]) -> String {
    whorl_math::words::or_did_you_mean(name, known.iter().map(String::as_str))
}

/// The experiments that there are, in words.
fn among(known: &[String]) -> String {
    match known {
        [] => "there are no others: start it in the folder that holds params/experiments; `whorl init` makes one".to_owned(),
        known => format!("not one of {}", known.join(" ")),
    }
}

fn listed(cpus: &[usize]) -> String {
    cpus.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")
}
