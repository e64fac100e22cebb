//! When to renew our endpoints after the network was cut. Pure: time and events come in.
//!
//! RustDDS 0.15 drops a participant that was silent for its lease (50 s). When it is heard
//! again, RustDDS restores what it knew of its endpoints but does not match them with ours, and
//! takes their repeated announcements for duplicates: data never flows again between the two
//! (RustDDS `discovery_db.rs`, "attic"; `dds_cache.rs`, `add_change`). A *new* endpoint, on the
//! other hand, is matched with all known endpoints and announced under a new number. So, when a
//! dropped participant returns, all our endpoints are created again, and the old
//! ones are dropped once the new ones have found their peers. Either side doing this suffices.
//!
//! For a fast recovery the participants must hear of each other soon, but they announce themselves every
//! 10 s. While a participant is missing, we make all others announce themselves twice a second (see
//! `nudge.rs`). Measured: data flows again 0.25 to 0.8 s after the end of cuts of 48 to 120 s.

use std::collections::HashMap;
use std::time::Duration;

use crate::peers::{ParticipantPrefix, PeerEvent};

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Create all endpoints again.
    Renew(Reason),
    /// Make all participants announce themselves.
    Announce,
}

/// Why endpoints are renewed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A dropped participant has returned.
    PeerReturned,
    /// A subscription is silent although its writer is on the network.
    Silence,
}

/// How often announcements are repeated while somebody is missing.
pub(crate) const ANNOUNCE_PERIOD: Duration = Duration::from_millis(500);

/// Time constants of the recovery.
#[derive(Debug, Clone, Copy)]
pub struct RecoveryTimes {
    /// Several participants return within milliseconds: wait for all of them.
    pub settle: Duration,
    /// Shortest time between two renewals.
    pub pause: Duration,
    /// Time between announcements while a participant is missing.
    pub announce_period: Duration,
    /// After this time a missing participant is considered dead: it is no longer
    /// called, but still known should it return.
    pub give_up: Duration,
    /// Silence of a subscription with a known writer that triggers a renewal; doubles with
    /// every renewal that did not help.
    pub silence: Duration,
}

impl Default for RecoveryTimes {
    fn default() -> Self {
        Self {
            settle: Duration::from_millis(100),
            pause: Duration::from_millis(500),
            announce_period: ANNOUNCE_PERIOD,
            give_up: Duration::from_secs(900),
            // Longer than the lease of 50 s, so that the return of a peer is dealt with first.
            silence: Duration::from_secs(75),
        }
    }
}

impl RecoveryTimes {
    /// For a network of this machine only: it cannot be cut, so a missing participant is dead.
    #[must_use]
    pub fn localhost() -> Self {
        Self { give_up: Duration::ZERO, ..Self::default() }
    }
}

/// Number of departed participants that are remembered.
const REMEMBERED: usize = 256;

/// Missing participants, and the actions taken.
#[derive(Debug)]
pub struct Recovery {
    times: RecoveryTimes,
    missing: HashMap<ParticipantPrefix, Duration>,
    called: usize,
    renew_at: Option<Duration>,
    last_renewal: Option<Duration>,
    next_announcement: Duration,
    silence_limit: Duration,
    renewals: u64,
}

impl Recovery {
    /// A recovery without any known participant.
    #[must_use]
    pub fn new(times: RecoveryTimes) -> Self {
        Self {
            times,
            missing: HashMap::new(),
            called: 0,
            renew_at: None,
            last_renewal: None,
            next_announcement: Duration::ZERO,
            silence_limit: times.silence,
            renewals: 0,
        }
    }

    /// Records a change among the peers at monotonic time `now`.
    pub fn peer(&mut self, now: Duration, event: PeerEvent) {
        match event {
            PeerEvent::TimedOut(peer) => {
                if self.called == 0 {
                    self.next_announcement = now + self.times.announce_period;
                }
                if self.missing.len() >= REMEMBERED {
                    let oldest = self.missing.iter().min_by_key(|(_, since)| **since).map(|(peer, _)| *peer);
                    oldest.map(|peer| self.missing.remove(&peer));
                }
                self.missing.insert(peer, now);
            }
            PeerEvent::Left(peer) => {
                self.missing.remove(&peer);
            }
            PeerEvent::Discovered(peer) => {
                let was_missing = self.missing.remove(&peer).is_some();
                if was_missing {
                    self.schedule(now);
                }
            }
            _ => {}
        }
    }

    fn schedule(&mut self, now: Duration) {
        let earliest = self.last_renewal.map_or(Duration::ZERO, |last| last + self.times.pause);
        // Not moved by further returns, or a stream of them would postpone it for ever.
        self.renew_at.get_or_insert((now + self.times.settle).max(earliest));
    }

    /// What to do at `now`. `longest_silence` is that of the subscriptions which once delivered
    /// and whose writer is still on the network.
    pub fn act(&mut self, now: Duration, longest_silence: Option<Duration>) -> Option<Action> {
        let give_up = self.times.give_up;
        self.called = self.missing.values().filter(|since| now.saturating_sub(**since) < give_up).count();
        match longest_silence {
            None => self.silence_limit = self.times.silence,
            Some(silence) => {
                let since_renewal = self.last_renewal.map_or(now, |last| now.saturating_sub(last));
                if silence.min(since_renewal) >= self.silence_limit {
                    self.silence_limit *= 2;
                    return Some(self.renew(now, Reason::Silence));
                }
            }
        }
        if self.renew_at.is_some_and(|at| now >= at) {
            return Some(self.renew(now, Reason::PeerReturned));
        }
        if self.called > 0 && now >= self.next_announcement {
            self.next_announcement = now + self.times.announce_period;
            return Some(Action::Announce);
        }
        None
    }

    fn renew(&mut self, now: Duration, reason: Reason) -> Action {
        self.renew_at = None;
        self.last_renewal = Some(now);
        self.renewals += 1;
        Action::Renew(reason)
    }

    /// How many participants are missing and not yet considered dead.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.called
    }

    /// How often endpoints were renewed.
    #[must_use]
    pub fn renewals(&self) -> u64 {
        self.renewals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: ParticipantPrefix = [1; 12];
    const B: ParticipantPrefix = [2; 12];

    fn seconds(s: f64) -> Duration {
        Duration::from_secs_f64(s)
    }

    fn recovery() -> Recovery {
        Recovery::new(RecoveryTimes::default())
    }

    /// All actions in `from..to`, asked every 10 ms.
    fn actions(recovery: &mut Recovery, from: f64, to: f64) -> Vec<(f64, Action)> {
        (0..((to - from) * 100.0).round() as u32)
            .map(|i| from + f64::from(i) * 0.01)
            .filter_map(|t| recovery.act(seconds(t), None).map(|action| (t, action)))
            .collect()
    }

    #[test]
    fn peers_that_come_and_go_properly_cause_nothing() {
        let mut r = recovery();
        r.peer(seconds(0.0), PeerEvent::Discovered(A));
        r.peer(seconds(1.0), PeerEvent::Left(A));
        r.peer(seconds(2.0), PeerEvent::Discovered(A));
        assert!(actions(&mut r, 0.0, 200.0).is_empty());
    }

    #[test]
    fn a_missing_peer_is_called_twice_a_second_and_its_return_renews_once() {
        let mut r = recovery();
        r.peer(seconds(50.0), PeerEvent::TimedOut(A));
        r.peer(seconds(50.5), PeerEvent::TimedOut(B));
        let calls = actions(&mut r, 50.5, 60.0);
        assert_eq!(calls.len(), 18);
        assert!(calls.iter().all(|(_, action)| *action == Action::Announce));
        // Both return within the settling time: one renewal.
        r.peer(seconds(60.0), PeerEvent::Discovered(A));
        r.peer(seconds(60.05), PeerEvent::Discovered(B));
        let after = actions(&mut r, 60.05, 90.0);
        assert_eq!(after.len(), 1, "{after:?}");
        assert_eq!(after[0].1, Action::Renew(Reason::PeerReturned));
        assert!((after[0].0 - 60.1).abs() < 0.011);
    }

    #[test]
    fn a_flapping_link_renews_at_most_twice_a_second() {
        let mut r = recovery();
        let mut renewals = Vec::new();
        for i in 0..100 {
            let t = f64::from(i) * 0.1;
            r.peer(seconds(t), PeerEvent::TimedOut(A));
            r.peer(seconds(t), PeerEvent::Discovered(A));
            renewals.extend(actions(&mut r, t, t + 0.1));
        }
        assert!((16..=21).contains(&renewals.len()), "{renewals:?}");
        assert!(renewals.windows(2).all(|w| w[1].0 - w[0].0 > 0.49));
    }

    #[test]
    fn the_dead_are_given_up_but_known_when_they_return() {
        let mut r = recovery();
        r.peer(seconds(0.0), PeerEvent::TimedOut(A));
        assert_eq!(r.act(seconds(899.0), None), Some(Action::Announce));
        assert_eq!(r.missing(), 1);
        assert!(r.act(seconds(901.0), None).is_none());
        assert_eq!(r.missing(), 0);
        r.peer(seconds(5000.0), PeerEvent::Discovered(A));
        assert_eq!(r.act(seconds(5000.2), None), Some(Action::Renew(Reason::PeerReturned)));
    }

    #[test]
    fn on_this_machine_nobody_is_called_but_one_that_was_stopped_is_welcome() {
        let mut r = Recovery::new(RecoveryTimes::localhost());
        r.peer(seconds(0.0), PeerEvent::TimedOut(A));
        assert!(actions(&mut r, 0.0, 100.0).is_empty());
        r.peer(seconds(100.0), PeerEvent::Discovered(A));
        assert_eq!(actions(&mut r, 100.0, 200.0).len(), 1);
    }

    #[test]
    fn memory_of_the_dead_is_bounded() {
        let mut r = recovery();
        for i in 0..10_000_u32 {
            let mut peer = A;
            peer[..4].copy_from_slice(&i.to_be_bytes());
            r.peer(Duration::from_millis(u64::from(i)), PeerEvent::TimedOut(peer));
        }
        assert_eq!(r.missing.len(), REMEMBERED);
    }

    #[test]
    fn silence_of_a_known_writer_renews_with_growing_patience() {
        let mut r = recovery();
        let mut times = Vec::new();
        for t in 0..1000 {
            if let Some(action) = r.act(seconds(f64::from(t)), Some(seconds(f64::from(t)))) {
                assert_eq!(action, Action::Renew(Reason::Silence));
                times.push(t);
            }
        }
        // 75 s, then 150 s and 300 s after the one before.
        assert_eq!(times, [75, 225, 525]);
        // Data again: patience starts anew.
        assert!(r.act(seconds(1000.0), None).is_none());
        assert!(r.act(seconds(1700.0), Some(seconds(76.0))).is_some());
    }
}
