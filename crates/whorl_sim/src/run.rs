//! One simulated experiment from start to end.

use std::time::Duration;

use whorl_node::Timestamp;

use crate::bus::Observer;
use crate::node_set::NodeSet;

/// How a simulation ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Whether the coordinator finished its experiment (or aborted it), rather than time running out.
    pub finished: bool,
    /// Simulated time \[s\].
    pub simulated_s: f64,
}

/// Simulated time between two progress reports.
const SLICE: Duration = Duration::from_millis(500);

/// Runs until the coordinator has finished, at most `longest` of simulated time. `progress` gets
/// the simulated time so far.
///
/// # Errors
/// The observer's.
pub fn run<O: Observer>(
    set: &mut NodeSet,
    longest: Duration,
    observer: &mut O,
    mut progress: impl FnMut(f64),
) -> Result<Outcome, O::Error> {
    let start = set.bus.now();
    let end = start + longest;
    let mut finished = false;
    while !finished && set.bus.now() < end {
        let until: Timestamp = (set.bus.now() + SLICE).min(end);
        set.bus.run_until(until, observer)?;
        finished = set.bus.finished("/coordinator");
        progress(set.bus.now().seconds_since(start));
    }
    set.bus.shut_down(observer)?;
    Ok(Outcome { finished, simulated_s: set.bus.now().seconds_since(start) })
}
