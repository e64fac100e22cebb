//! When a process that ended by accident is started again.

use std::time::{Duration, Instant};

/// It is started again at once so often within [`RESTARTS_WITHIN`]. Then it is not bad luck, but perhaps somebody's doing:
/// every further start waits twice as long, and nobody can end a run by giving it reasons.
const RESTARTS: usize = 5;
const RESTARTS_WITHIN: Duration = Duration::from_secs(300);
const FIRST_WAIT: Duration = Duration::from_secs(5);
const LONGEST_WAIT: Duration = Duration::from_secs(60);

/// The latest restarts of one process.
#[derive(Debug, Clone, Default)]
pub struct Restarts(Vec<Instant>);

impl Restarts {
    /// Counts one more at `now`; returns how long it waits.
    pub fn next_wait(&mut self, now: Instant) -> Duration {
        self.0.retain(|at| now.duration_since(*at) < RESTARTS_WITHIN);
        let often = self.0.len();
        self.0.push(now);
        match often.checked_sub(RESTARTS) {
            None => Duration::ZERO,
            Some(more) => LONGEST_WAIT.min(FIRST_WAIT * (1 << more.min(8))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_ends_often_waits_longer_and_never_for_ever() {
        let begin = Instant::now();
        let mut restarts = Restarts::default();
        let waits: Vec<u64> = (0..12).map(|_| restarts.next_wait(begin).as_secs()).collect();
        assert_eq!(waits, [0, 0, 0, 0, 0, 5, 10, 20, 40, 60, 60, 60]);
        assert_eq!(restarts.next_wait(begin + RESTARTS_WITHIN), Duration::ZERO, "an old accident counts");
    }
}
