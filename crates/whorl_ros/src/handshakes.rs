//! Handshakes of DDS Security that do not end. Pure: time and peers come in.
//!
//! When many participants start at once on a busy machine, RustDDS 0.15 sometimes loses a message of a handshake for good:
//! one side waits for ever, neither tells the other its endpoints, and no data flows between the two. A new participant makes
//! a new handshake. It also ends the handshakes that were well, so it is for those only who lack something: a node one of
//! whose subscriptions has no publisher. Nobody else needs it, whether the handshake that does not end is that of a stranger, of
//! an operator who has left already, or of a node that reads from us and lacks us. And it is not done often.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use crate::error::RosError;
use crate::peers::{ParticipantPrefix, PeerEvent};

/// A handshake that takes longer than this does not end: RustDDS repeats a message once a second, ten times. Twice as long after
/// each new participant: on a computer that is too busy, many of them are why handshakes take long.
const LONGEST: Duration = Duration::from_secs(12);
/// Time in which we may join anew, from the start of the process: enough for [`MOST`] times.
const EARLY: Duration = Duration::from_secs(120);
/// How often.
const MOST: u32 = 3;
/// Peers that are remembered: all that one machine holds, several times.
const REMEMBERED: usize = 256;

/// Peers whose endpoints are not yet known.
#[derive(Debug, Clone)]
pub struct Handshakes {
    began: Duration,
    renewals: u32,
    open: HashMap<ParticipantPrefix, Duration>,
}

impl Handshakes {
    /// Nobody is known; `now` is the start of the process.
    #[must_use]
    pub fn new(now: Duration) -> Self {
        Self { began: now, renewals: 0, open: HashMap::new() }
    }

    /// For a new participant in place of one with handshakes that did not end.
    #[must_use]
    pub fn renewed(&self) -> Self {
        Self { open: HashMap::new(), renewals: self.renewals + 1, ..*self }
    }

    /// Records a change among the peers.
    pub fn peer(&mut self, now: Duration, event: PeerEvent) {
        match event {
            // The second follows the first when the handshake has ended, and begins the exchange of endpoints.
            PeerEvent::Authenticating(peer) | PeerEvent::Discovered(peer)
                if self.is_early(now) && self.open.len() < REMEMBERED =>
            {
                self.open.insert(peer, now);
            }
            PeerEvent::Left(peer) | PeerEvent::TimedOut(peer) | PeerEvent::Rejected(peer) => {
                self.open.remove(&peer);
            }
            _ => {}
        }
    }

    /// Fails when a handshake does not end; `known` gives those whose endpoints are known.
    ///
    /// # Errors
    /// [`RosError::Stuck`]: only a new participant helps.
    pub fn look(
        &mut self,
        now: Duration,
        known: impl FnOnce() -> HashSet<ParticipantPrefix>,
    ) -> Result<(), RosError> {
        if !self.are_due(now) {
            return Ok(());
        }
        let known = known();
        match self.stuck(now, |peer| known.contains(peer)) {
            0 => Ok(()),
            count => Err(RosError::Stuck { doing: format!("exchanging keys with {count} participant(s)") }),
        }
    }

    /// Whether it is worth asking [`Self::stuck`].
    fn are_due(&self, now: Duration) -> bool {
        self.is_early(now)
            && self.renewals < MOST
            && self.open.values().any(|since| now.saturating_sub(*since) > self.longest())
    }

    /// How many handshakes do not end, given those whose endpoints are known.
    fn stuck(&mut self, now: Duration, known: impl Fn(&ParticipantPrefix) -> bool) -> usize {
        self.open.retain(|peer, _| !known(peer));
        let longest = self.longest();
        self.open.values().filter(|since| now.saturating_sub(**since) > longest).count()
    }

    fn longest(&self) -> Duration {
        LONGEST * (1 << self.renewals.min(MOST))
    }

    fn is_early(&self, now: Duration) -> bool {
        now.saturating_sub(self.began) < EARLY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    const A: ParticipantPrefix = [1; 12];
    const B: ParticipantPrefix = [2; 12];

    #[test]
    fn a_handshake_that_does_not_end_is_found_but_only_early_and_not_often() {
        let mut handshakes = Handshakes::new(s(100));
        handshakes.peer(s(101), PeerEvent::Authenticating(A));
        handshakes.peer(s(101), PeerEvent::Authenticating(B));
        assert!(!handshakes.are_due(s(113)));
        assert!(handshakes.are_due(s(114)));
        assert_eq!(handshakes.stuck(s(114), |peer| *peer == A), 1);
        for wait_s in [12, 24, 48] {
            assert!(!handshakes.are_due(s(101 + wait_s)));
            assert!(handshakes.are_due(s(102 + wait_s)));
            handshakes = handshakes.renewed();
            handshakes.peer(s(101), PeerEvent::Discovered(B));
        }
        assert!(!handshakes.are_due(s(215)), "three times are enough");
        // Who comes later is not even remembered.
        let mut late = Handshakes::new(s(100));
        late.peer(s(221), PeerEvent::Authenticating(A));
        assert_eq!(late.stuck(s(300), |_| false), 0);
    }

    #[test]
    fn who_has_exchanged_keys_has_time_anew_for_its_endpoints() {
        let mut handshakes = Handshakes::new(s(0));
        handshakes.peer(s(1), PeerEvent::Authenticating(A));
        handshakes.peer(s(12), PeerEvent::Discovered(A));
        assert!(!handshakes.are_due(s(24)));
        assert!(handshakes.are_due(s(25)));
    }

    #[test]
    fn who_leaves_or_has_other_keys_is_not_waited_for() {
        for end in [PeerEvent::Left(A), PeerEvent::TimedOut(A), PeerEvent::Rejected(A)] {
            let mut handshakes = Handshakes::new(s(0));
            handshakes.peer(s(1), PeerEvent::Authenticating(A));
            handshakes.peer(s(2), end);
            assert!(!handshakes.are_due(s(20)), "{end:?}");
        }
    }
}
