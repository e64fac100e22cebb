//! The clocks of the platforms' computers: the only module that translates stamps of other nodes to this node's
//! time and back.
//!
//! One exchange: a request left at `asked` by this clock and arrived at `told` by the other clock, whose
//! reply arrived at `now` by this one. With the offset `o` (the other clock less this one) and the delays `there`
//! and `back`,
//!
//! ```text
//! told - asked = there + o,        now - told = back - o,        there, back >= 0
//! ```
//!
//! so `o` lies between `-(now - told)` and `told - asked`. Delays are never negative, so the smallest of each over a
//! window, widened with age by the clocks' drift, give the tightest bounds. The estimate is their middle, exact when
//! the shortest delays of both directions are equal (Mills, RFC 5905, section 8, with the minima
//! taken for each direction separately).

use std::collections::VecDeque;
use std::time::Duration;

use whorl_msgs::builtin_interfaces::Time;
use whorl_node::Timestamp;

/// Exchanges are used for this long \[s\]: those of a good link still help when it becomes poor.
const WINDOW_S: f64 = 300.0;
/// Largest relative drift of two clocks: the bounds of an exchange widen by this with its age \[s/s\].
const DRIFT: f64 = 2e-5;
/// Exchanges that took longer are not used \[s\].
const LONGEST_EXCHANGE_S: f64 = 2.0;
/// Smaller offsets are treated as zero \[s\]: at 5 deg/s this is an error of 0.01 deg.
const SAME_S: f64 = 2e-3;
/// The applied offset is updated when it differs from the measured one by more than this \[s\].
const FOLLOW_S: f64 = 1e-3;
/// Most exchanges that are kept: a window of requests at the higher rate.
const MOST_EXCHANGES: usize = 3000;
/// With fewer exchanges, requests are sent at the higher rate.
const ENOUGH: usize = 10;

/// Estimated offset of another clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ClockOffset {
    /// Other clock less this one \[s\].
    pub offset_s: f64,
    /// Bound on the error of the offset \[s\].
    pub uncertainty_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Exchange {
    at: Timestamp,
    there_s: f64,
    back_s: f64,
}

/// Clock of the sender of a platform's messages.
#[derive(Debug, Clone, Default)]
pub(crate) struct SenderClock {
    exchanges: VecDeque<Exchange>,
    measured: Option<ClockOffset>,
    applied_s: f64,
}

impl SenderClock {
    /// Takes a reply. True when stamps are translated by another amount from now on.
    pub fn take(&mut self, now: Timestamp, asked: Time, told: Time) -> bool {
        let (asked, told) = (Timestamp::from(asked), Timestamp::from(told));
        if !(0.0..=LONGEST_EXCHANGE_S).contains(&now.seconds_since(asked)) {
            return false;
        }
        let new = Exchange { at: now, there_s: told.seconds_since(asked), back_s: now.seconds_since(told) };
        self.exchanges.retain(|e| (0.0..=WINDOW_S).contains(&now.seconds_since(e.at)));
        if self.exchanges.len() >= MOST_EXCHANGES {
            self.exchanges.pop_front();
        }
        self.exchanges.push_back(new);
        let (mut there_s, mut back_s) = self.quickest_s(now);
        if there_s + back_s < 0.0 {
            // A negative delay: one of the clocks was set in between.
            self.exchanges.clear();
            self.exchanges.push_back(new);
            (there_s, back_s) = (new.there_s, new.back_s);
        }
        let offset_s = 0.5 * (there_s - back_s);
        self.measured = Some(ClockOffset { offset_s, uncertainty_s: 0.5 * (there_s + back_s) });
        let wanted_s = if offset_s.abs() < SAME_S { 0.0 } else { offset_s };
        let changes = (wanted_s - self.applied_s).abs() > FOLLOW_S;
        if changes {
            self.applied_s = wanted_s;
        }
        changes
    }

    fn quickest_s(&self, now: Timestamp) -> (f64, f64) {
        self.exchanges.iter().fold((f64::INFINITY, f64::INFINITY), |(there_s, back_s), e| {
            let drift_s = DRIFT * now.seconds_since(e.at);
            (there_s.min(e.there_s + drift_s), back_s.min(e.back_s + drift_s))
        })
    }

    /// The estimated offset, if there is one.
    pub fn measured(&self) -> Option<ClockOffset> {
        self.measured
    }

    /// The offset by which stamps are translated \[s\].
    pub fn applied_s(&self) -> f64 {
        self.applied_s
    }

    /// Whether the offset rests on few exchanges.
    pub fn hardly_known(&self) -> bool {
        self.exchanges.len() < ENOUGH
    }

    /// A stamp of the sender, in this node's time.
    pub fn to_local(&self, stamp: Time) -> Timestamp {
        Timestamp(Timestamp::from(stamp).0.saturating_sub(self.applied_ns()))
    }

    /// An instant of this node's time, by the other clock.
    pub fn to_remote(&self, at: Timestamp) -> Timestamp {
        Timestamp(at.0.saturating_add(self.applied_ns()))
    }

    fn applied_ns(&self) -> i64 {
        (self.applied_s * 1e9) as i64
    }
}

/// Ticks of `period` between two requests: twice a second, and faster while there are few exchanges with a platform
/// that is present.
pub(crate) fn ticks_between_requests(period: Duration, hurry: bool) -> u64 {
    let every_s = if hurry { 0.1 } else { 0.5 };
    ((every_s / period.as_secs_f64()).round() as u64).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic delays in 0..1, without a generator: multiples of the golden ratio.
    fn spread(k: u32) -> f64 {
        (f64::from(k) * 0.618_033_988_749_895).fract()
    }

    /// `count` exchanges, two a second, with a clock that is `offset_s` ahead.
    fn exchanges(
        clock: &mut SenderClock,
        from_s: f64,
        count: u32,
        offset_s: f64,
        delay_s: impl Fn(u32) -> f64,
    ) {
        for k in 0..count {
            let asked_s = from_s + 0.5 * f64::from(k);
            let told_s = asked_s + delay_s(2 * k) + offset_s;
            let now_s = asked_s + delay_s(2 * k) + delay_s(2 * k + 1);
            let time = |s: f64| Time::from(Timestamp::from_seconds(s));
            clock.take(Timestamp::from_seconds(now_s), time(asked_s), time(told_s));
        }
    }

    #[test]
    fn the_offset_is_found_through_delays_that_differ_each_time() {
        for offset_s in [-3600.0, -0.05, 0.05, 0.3, 10.0] {
            let mut clock = SenderClock::default();
            // 20 to 200 ms on each way.
            exchanges(&mut clock, 1e6, 60, offset_s, |k| 0.02 + 0.18 * spread(k));
            let measured = clock.measured().unwrap();
            assert!((measured.offset_s - offset_s).abs() < 4e-3, "{measured:?} for {offset_s}");
            assert!((0.02..0.03).contains(&measured.uncertainty_s), "{measured:?}");
            let local = clock.to_local(Timestamp::from_seconds(1e6 + offset_s).into());
            assert!((local.seconds() - 1e6).abs() < 5e-3, "{local}");
            assert!(
                clock.to_remote(local).seconds_since(Timestamp::from_seconds(1e6 + offset_s)).abs() < 1e-6
            );
        }
    }

    #[test]
    fn it_is_never_further_off_than_it_says_however_unlike_the_ways_are() {
        for (there_s, back_s) in [(0.0, 0.2), (0.2, 0.0), (0.1, 0.11), (1.0, 0.001)] {
            let mut clock = SenderClock::default();
            exchanges(&mut clock, 1e3, 5, 0.05, |k| if k % 2 == 0 { there_s } else { back_s });
            let measured = clock.measured().unwrap();
            assert!((measured.offset_s - 0.05).abs() <= measured.uncertainty_s + 1e-6, "{measured:?}");
        }
    }

    #[test]
    fn a_link_that_becomes_poor_does_not_make_the_clock_unknown() {
        let mut clock = SenderClock::default();
        exchanges(&mut clock, 1e3, 20, 0.05, |_| 1e-3);
        for k in 0..400_u32 {
            exchanges(&mut clock, 1e3 + 10.0 + 0.5 * f64::from(k), 1, 0.05, |j| {
                0.02 + 0.18 * spread(2 * k + j)
            });
            assert!((clock.applied_s() - 0.05).abs() < 2e-3, "{} after {k}", clock.applied_s());
        }
    }

    #[test]
    fn clocks_of_one_computer_are_one_clock() {
        let mut clock = SenderClock::default();
        exchanges(&mut clock, 1e3, 100, 0.0, |k| 1e-4 + 2e-3 * spread(k));
        assert_eq!(clock.applied_s(), 0.0);
    }

    #[test]
    fn a_clock_that_is_set_is_followed_at_once() {
        for step_s in [1.0, -1.0] {
            let mut clock = SenderClock::default();
            exchanges(&mut clock, 1e3, 60, 0.05, |_| 0.01);
            assert!((clock.applied_s() - 0.05).abs() < 1e-6);
            exchanges(&mut clock, 1e3 + 30.0, 1, 0.05 + step_s, |_| 0.01);
            assert!((clock.applied_s() - 0.05 - step_s).abs() < 1e-6, "{}", clock.applied_s());
        }
    }

    #[test]
    fn a_reply_to_nothing_that_was_asked_is_ignored() {
        let mut clock = SenderClock::default();
        let time = |s: f64| Time::from(Timestamp::from_seconds(s));
        assert!(!clock.take(Timestamp::from_seconds(100.0), time(101.0), time(100.0)));
        assert!(!clock.take(Timestamp::from_seconds(100.0), time(90.0), time(95.0)));
        assert_eq!(clock.measured(), None);
    }
}
