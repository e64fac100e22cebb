//! Wall-clock time that never runs backwards, and the schedule of a periodic timer.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustix::time::{ClockId, Timespec, clock_gettime};
use whorl_node::Timestamp;

/// Time for a core: the wall clock, held constant after it has been set back (NTP, an operator).
#[derive(Debug, Default)]
pub struct Clock {
    last: Timestamp,
}

impl Clock {
    /// The current time; never earlier than at the previous call.
    pub fn now(&mut self) -> Timestamp {
        self.advance(wall_clock())
    }

    fn advance(&mut self, wall: Timestamp) -> Timestamp {
        self.last = self.last.max(wall);
        self.last
    }
}

/// The system's wall clock; the epoch itself when it is set before 1970.
#[must_use]
pub fn wall_clock() -> Timestamp {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX))
}

/// Time of the monotonic clock, which is never set, since an arbitrary origin.
#[must_use]
pub fn monotonic() -> Duration {
    let Timespec { tv_sec, tv_nsec } = clock_gettime(ClockId::Monotonic);
    // The monotonic clock counts from boot: both parts are non-negative, and tv_nsec < 1e9.
    Duration::new(u64::try_from(tv_sec).unwrap_or(0), u32::try_from(tv_nsec).unwrap_or(0))
}

/// Firings at start + n * period, n = 1, 2, ...: a late one does not shift the next ones.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    start: Duration,
    period: Duration,
    fired: u64,
}

impl Schedule {
    /// A schedule from the monotonic time `start` on. `None` for a period of zero.
    #[must_use]
    pub fn new(start: Duration, period: Duration) -> Option<Self> {
        (!period.is_zero()).then_some(Self { start, period, fired: 0 })
    }

    /// Monotonic time of the next firing.
    #[must_use]
    pub fn next(&self) -> Duration {
        let nanoseconds = self.period.as_nanos().saturating_mul(u128::from(self.fired) + 1);
        self.start + Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(u64::MAX))
    }

    /// Counts one firing if it is due.
    pub fn fire(&mut self, now: Duration) -> bool {
        let due = now >= self.next();
        self.fired += u64::from(due);
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stands_still_while_the_wall_clock_is_set_back() {
        let mut clock = Clock::default();
        let told: Vec<_> = [5, 7, 6, 3, 8].map(|s| clock.advance(Timestamp(s)).0).into();
        assert_eq!(told, [5, 7, 7, 7, 8]);
    }

    #[test]
    fn a_late_firing_neither_skips_nor_shifts() {
        let ms = Duration::from_millis;
        let mut schedule = Schedule::new(ms(1000), ms(10)).unwrap();
        assert!(!schedule.fire(ms(1009)));
        // 35 ms late: three firings are owed, then the grid goes on.
        assert_eq!((0..5).filter(|_| schedule.fire(ms(1035))).count(), 3);
        assert_eq!(schedule.next(), ms(1040));
        assert!(Schedule::new(ms(0), ms(0)).is_none());
    }

    #[test]
    fn a_period_that_is_no_whole_number_of_nanoseconds_in_a_second_does_not_drift() {
        let mut schedule = Schedule::new(Duration::ZERO, Duration::from_nanos(3_333_333)).unwrap();
        let mut now = Duration::ZERO;
        for _ in 0..300 {
            now = schedule.next();
            assert!(schedule.fire(now));
        }
        assert_eq!(now, Duration::from_nanos(3_333_333 * 300));
    }
}
