//! Decides whether the sequence waits for a platform, and when the wait is too long.

use whorl_node::Timestamp;

use crate::parameters::{FaultSettings, LinkSettings};

/// What one platform contributes to the decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlatformCondition {
    /// Its estimate is fresh.
    pub fresh: bool,
    /// Its estimate is fresh and healthy.
    pub usable: bool,
    /// Its controller follows its reference.
    pub following: bool,
    /// It can be heard but does not hear: its controller has no authority, which is being sent.
    pub deaf: bool,
    /// The steps move it directly, or the law moves all platforms as one rigid structure.
    pub leads: bool,
}

/// State of the sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PauseDecision {
    /// Continues.
    Go,
    /// Waits.
    Wait,
    /// A link has been stale for too long.
    LinkTimeout,
    /// A platform has not followed for too long.
    FaultTimeout,
}

/// Watches all platforms.
#[derive(Debug, Clone, Default)]
pub(crate) struct PauseWatch {
    not_following_since: Vec<Option<Timestamp>>,
    link_since: Option<Timestamp>,
    fault_since: Option<Timestamp>,
}

impl PauseWatch {
    pub fn new(platforms: usize) -> Self {
        Self { not_following_since: vec![None; platforms], link_since: None, fault_since: None }
    }

    pub fn evaluate(
        &mut self,
        now: Timestamp,
        conditions: &[PlatformCondition],
        link: &LinkSettings,
        faults: &FaultSettings,
    ) -> PauseDecision {
        let (mut link_down, mut fault) = (false, false);
        for (condition, since) in conditions.iter().zip(&mut self.not_following_since) {
            // A platform without a fresh estimate is a link fault, regardless of its controller; so is one that cannot hear
            // us: a link that is cut in one direction is as much cut as one that is cut in both.
            let stopped = condition.fresh && (condition.deaf || !(condition.following && condition.usable));
            *since = if stopped { since.or(Some(now)) } else { None };
            let for_long = since.is_some_and(|since| now.seconds_since(since) > faults.grace_s);
            let cut = !condition.fresh || (condition.deaf && for_long);
            fault |= (condition.leads || faults.wait_for_followers) && for_long && !condition.deaf;
            link_down |= cut && (condition.leads || link.leader_waits);
        }
        self.link_since = if link_down { self.link_since.or(Some(now)) } else { None };
        self.fault_since = if fault { self.fault_since.or(Some(now)) } else { None };
        let longer = |since: Option<Timestamp>, limit_s: f64| {
            since.is_some_and(|since| now.seconds_since(since) > limit_s)
        };
        if longer(self.fault_since, faults.timeout_s) {
            PauseDecision::FaultTimeout
        } else if longer(self.link_since, link.timeout_s) {
            PauseDecision::LinkTimeout
        } else if link_down || fault {
            PauseDecision::Wait
        } else {
            PauseDecision::Go
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: PlatformCondition =
        PlatformCondition { fresh: true, usable: true, following: true, deaf: false, leads: true };
    const FAULTS: FaultSettings =
        FaultSettings { wait_for_followers: true, grace_s: 1.0, timeout_s: 20.0, abort_for_s: 10.0 };

    fn link(leader_waits: bool) -> LinkSettings {
        LinkSettings {
            stale_s: 0.3,
            status_stale_s: 1.0,
            leader_waits,
            rejoin_error_rad: 0.03,
            timeout_s: 300.0,
        }
    }

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(seconds)
    }

    #[test]
    fn a_platform_that_stops_following_pauses_after_the_grace_and_aborts_after_the_timeout() {
        let mut watch = PauseWatch::new(2);
        let bad = [GOOD, PlatformCondition { following: false, leads: false, ..GOOD }];
        let expected = [
            (0.0, PauseDecision::Go),
            (0.9, PauseDecision::Go),
            (1.1, PauseDecision::Wait),
            (21.0, PauseDecision::Wait),
            (21.2, PauseDecision::FaultTimeout),
        ];
        for (seconds, verdict) in expected {
            assert_eq!(watch.evaluate(at(seconds), &bad, &link(true), &FAULTS), verdict, "{seconds}");
        }
        assert_eq!(watch.evaluate(at(22.0), &[GOOD, GOOD], &link(true), &FAULTS), PauseDecision::Go);
        assert_eq!(watch.evaluate(at(22.5), &bad, &link(true), &FAULTS), PauseDecision::Go);
    }

    #[test]
    fn a_follower_that_fails_is_left_behind_when_told_so_a_leader_never() {
        let faults = FaultSettings { wait_for_followers: false, ..FAULTS };
        for (leads, late) in [(false, PauseDecision::Go), (true, PauseDecision::Wait)] {
            let mut watch = PauseWatch::new(1);
            let bad = [PlatformCondition { following: false, leads, ..GOOD }];
            watch.evaluate(at(0.0), &bad, &link(true), &faults);
            assert_eq!(watch.evaluate(at(2.0), &bad, &link(true), &faults), late);
        }
    }

    #[test]
    fn an_unhealthy_estimate_is_a_fault_too() {
        let mut watch = PauseWatch::new(1);
        let bad = [PlatformCondition { usable: false, ..GOOD }];
        watch.evaluate(at(0.0), &bad, &link(true), &FAULTS);
        assert_eq!(watch.evaluate(at(2.0), &bad, &link(true), &FAULTS), PauseDecision::Wait);
    }

    #[test]
    fn a_platform_that_hears_nothing_is_waited_for_as_one_that_is_not_heard() {
        // For 125 s, cut in one direction, and in both; far beyond the time for a platform that fails.
        let deaf = PlatformCondition { following: false, deaf: true, ..GOOD };
        let silent = PlatformCondition { fresh: false, usable: false, following: false, ..GOOD };
        for cut in [deaf, silent] {
            let mut watch = PauseWatch::new(2);
            let after_grace: Vec<PauseDecision> = (0..1250)
                .map(|k| watch.evaluate(at(f64::from(k) * 0.1), &[GOOD, cut], &link(true), &FAULTS))
                .skip(11)
                .collect();
            assert!(after_grace.iter().all(|decision| *decision == PauseDecision::Wait), "{cut:?}");
            assert_eq!(watch.evaluate(at(125.0), &[GOOD, GOOD], &link(true), &FAULTS), PauseDecision::Go);
            let for_ever = watch.evaluate(at(126.0), &[GOOD, cut], &link(true), &FAULTS);
            assert_ne!(for_ever, PauseDecision::LinkTimeout, "{cut:?}");
            watch.evaluate(at(128.0), &[GOOD, cut], &link(true), &FAULTS);
            let late = watch.evaluate(at(429.0), &[GOOD, cut], &link(true), &FAULTS);
            assert_eq!(late, PauseDecision::LinkTimeout, "{cut:?}");
        }
    }

    #[test]
    fn a_stale_leader_always_pauses_a_stale_follower_only_if_told() {
        let stale =
            PlatformCondition { fresh: false, usable: false, following: false, deaf: false, leads: true };
        let follower = PlatformCondition { leads: false, ..stale };
        for (conditions, waits, verdict) in [
            ([stale, GOOD], false, PauseDecision::Wait),
            ([GOOD, follower], false, PauseDecision::Go),
            ([GOOD, follower], true, PauseDecision::Wait),
        ] {
            let mut watch = PauseWatch::new(2);
            assert_eq!(watch.evaluate(at(0.0), &conditions, &link(waits), &FAULTS), verdict);
            let late = watch.evaluate(at(301.0), &conditions, &link(waits), &FAULTS);
            let expected =
                if verdict == PauseDecision::Wait { PauseDecision::LinkTimeout } else { PauseDecision::Go };
            assert_eq!(late, expected);
        }
    }
}
