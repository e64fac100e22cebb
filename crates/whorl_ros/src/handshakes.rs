//! Handshakes of DDS Security that do not end. Pure: time and peers come in.
//!
//! When many participants start at once on a busy machine, RustDDS 0.15 sometimes loses the last message of a handshake
//! for good: one side waits for ever, neither tells the other its endpoints, and no data flows between the two. A new
//! participant makes a new handshake. Strangers, whose handshakes never end, must not make us join anew again and again:
//! it is done in the first seconds of a process only, and not often.

use std::collections::HashMap;
use std::time::Duration;

use crate::peers::{ParticipantPrefix, PeerEvent};

/// A handshake that takes longer than this will not end; RustDDS repeats its messages once a second.
const LONGEST: Duration = Duration::from_secs(4);
/// Time in which we may join anew, from the start of the process.
const EARLY: Duration = Duration::from_secs(25);
/// How often.
const MOST: u32 = 3;

/// Peers whose endpoints are not yet known.
#[derive(Debug, Clone)]
pub(crate) struct Handshakes {
    began: Duration,
    renewals: u32,
    open: HashMap<ParticipantPrefix, Duration>,
}

impl Handshakes {
    /// Nobody is known; `now` is the start of the process.
    pub(crate) fn new(now: Duration) -> Self {
        Self { began: now, renewals: 0, open: HashMap::new() }
    }

    /// For a new participant in place of one with handshakes that did not end.
    pub(crate) fn renewed(&self) -> Self {
        Self { open: HashMap::new(), renewals: self.renewals + 1, ..*self }
    }

    /// Records a change among the peers.
    pub(crate) fn peer(&mut self, now: Duration, event: PeerEvent) {
        match event {
            PeerEvent::Discovered(peer) if self.is_early(now) => {
                self.open.insert(peer, now);
            }
            PeerEvent::Left(peer) | PeerEvent::TimedOut(peer) => {
                self.open.remove(&peer);
            }
            _ => {}
        }
    }

    /// Whether it is worth asking [`Self::stuck`].
    pub(crate) fn are_due(&self, now: Duration) -> bool {
        self.is_early(now)
            && self.renewals < MOST
            && self.open.values().any(|since| now.saturating_sub(*since) > LONGEST)
    }

    /// How many handshakes do not end, given those whose endpoints are known.
    pub(crate) fn stuck(&mut self, now: Duration, known: impl Fn(&ParticipantPrefix) -> bool) -> usize {
        self.open.retain(|peer, _| !known(peer));
        self.open.values().filter(|since| now.saturating_sub(**since) > LONGEST).count()
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

    #[test]
    fn a_handshake_that_does_not_end_is_found_but_only_early_and_not_often() {
        let mut handshakes = Handshakes::new(s(100));
        handshakes.peer(s(101), PeerEvent::Discovered([1; 12]));
        handshakes.peer(s(101), PeerEvent::Discovered([2; 12]));
        assert!(!handshakes.are_due(s(104)));
        assert!(handshakes.are_due(s(106)));
        assert_eq!(handshakes.stuck(s(106), |peer| *peer == [1; 12]), 1);
        for _ in 0..3 {
            assert!(handshakes.are_due(s(106)));
            handshakes = handshakes.renewed();
            handshakes.peer(s(101), PeerEvent::Discovered([2; 12]));
        }
        assert!(!handshakes.are_due(s(110)), "three times are enough");
        // A stranger who comes later is not even remembered.
        let mut late = Handshakes::new(s(100));
        late.peer(s(130), PeerEvent::Discovered([9; 12]));
        assert_eq!(late.stuck(s(200), |_| false), 0);
    }

    #[test]
    fn who_leaves_is_not_waited_for() {
        let mut handshakes = Handshakes::new(s(0));
        handshakes.peer(s(1), PeerEvent::Discovered([1; 12]));
        handshakes.peer(s(2), PeerEvent::Left([1; 12]));
        assert!(!handshakes.are_due(s(10)));
    }
}
