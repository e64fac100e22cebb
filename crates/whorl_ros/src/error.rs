//! What can go wrong between a node and the network.

use thiserror::Error;

/// Errors of this crate.
#[derive(Debug, Error)]
pub enum RosError {
    /// The command line.
    #[error(transparent)]
    Arguments(#[from] crate::arguments::ArgumentError),
    /// The environment.
    #[error(transparent)]
    Environment(#[from] crate::environment::EnvironmentError),
    /// Security.
    #[error(transparent)]
    Security(#[from] crate::security::SecurityRefusal),
    /// A name.
    #[error(transparent)]
    Name(#[from] crate::names::NameError),
    /// DDS refused something.
    #[error("DDS, {doing}: {reason}")]
    Dds {
        /// What was being done.
        doing: String,
        /// What DDS said.
        reason: String,
    },
    /// A call of DDS does not return.
    #[error("DDS got stuck {doing}")]
    Stuck {
        /// What was being done.
        doing: String,
    },
    /// The bytes to send are not little-endian CDR.
    #[error("{topic}: the bytes do not begin with the header of little-endian CDR (00 01 00 00)")]
    NotLittleEndianCdr {
        /// DDS name of the topic.
        topic: String,
    },
    /// A message that nobody of Whorl sends.
    #[error("{topic}: a message of {} kB was dropped; allowed: up to {} kB", bytes >> 10, allowed >> 10)]
    TooLarge {
        /// DDS name of the topic.
        topic: String,
        /// Its size.
        bytes: usize,
        /// The largest that is taken.
        allowed: usize,
    },
    /// A message that could not be encoded or decoded.
    #[error(transparent)]
    Cdr(#[from] whorl_msgs::cdr::CdrError),
    /// The operating system.
    #[error("{doing}: {source}")]
    Io {
        /// What was being done.
        doing: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// Nobody serves it.
    #[error(
        "nobody was found within {seconds:.1} s who serves {service}: does that node run, in this ROS_DOMAIN_ID?"
    )]
    NoServer {
        /// The service.
        service: String,
        /// How long it was looked for \[s\].
        seconds: f64,
    },
    /// A service that is there does not answer.
    #[error("no answer from {service} within {seconds:.1} s")]
    NoAnswer {
        /// Name of the service.
        service: String,
        /// How long we waited.
        seconds: f64,
    },
    /// The node's parameters.
    #[error("{0}")]
    Parameters(#[from] whorl_params::ParameterErrors),
    /// The core refused its parameters.
    #[error("{0}")]
    Core(String),
    /// The node ran to its end, but its task failed.
    #[error("{reason}")]
    Failed {
        /// Why.
        reason: String,
    },
    /// A platform's node outside the namespace of a platform.
    #[error(
        "the namespace {namespace} is not that of a platform ({platforms}): start the node with \
         `--ros-args -r __ns:=/<platform>`"
    )]
    Namespace {
        /// Namespace of the node.
        namespace: String,
        /// The platforms, for reading.
        platforms: String,
    },
    /// A core names a platform that is not in the list.
    #[error("the node uses platform number {index}, but only {count} platforms are configured")]
    Platform {
        /// Index, from 0.
        index: u16,
        /// Length of `formation.platforms`.
        count: usize,
    },
}

impl RosError {
    pub(crate) fn dds(doing: impl Into<String>, reason: impl std::fmt::Display) -> Self {
        Self::Dds { doing: doing.into(), reason: reason.to_string() }
    }

    pub(crate) fn io(doing: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { doing, source }
    }
}
