//! What the coordinator is doing.

use whorl_node::Timestamp;

use crate::run::Run;

/// What the coordinator is doing.
#[derive(Debug)]
pub(crate) enum Stage {
    /// Waits for estimates and controllers of all platforms.
    Waiting {
        /// Since when.
        since: Timestamp,
        /// Since when all platforms are ready.
        well_since: Option<Timestamp>,
    },
    /// Waits for the start.
    Ready,
    /// An experiment runs.
    Running(Box<Run>),
    /// The last step is over.
    Finished {
        /// The run, for its last references.
        run: Box<Run>,
        /// When.
        at: Timestamp,
    },
    /// It ended early.
    Aborted {
        /// The run, when there was one.
        run: Option<Box<Run>>,
        /// When.
        at: Timestamp,
        /// Why.
        reason: String,
    },
}

impl Stage {
    /// Whether it is `Running` or still holds a run.
    pub(crate) fn run(&self) -> Option<&Run> {
        match self {
            Self::Running(run) | Self::Finished { run, .. } | Self::Aborted { run: Some(run), .. } => {
                Some(run)
            }
            _ => None,
        }
    }
}
