//! A node's own time, and the schedule of a periodic timer.
//!
//! A node's time begins at the computer's time of day and then runs with its monotonic clock: nobody can set it, so no
//! deadline is ever late, and no age wrong, because an operator or NTP set the computer's clock. The time of day is for
//! what leaves the computer. This module alone knows by how much the two differ: stamps are translated where messages
//! come in and go out, so that other programs and computers see the time of day as they do everywhere.

use std::fmt;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rustix::time::{ClockId, Timespec, clock_gettime};
use whorl_msgs::Message;
use whorl_msgs::builtin_interfaces::Time;
use whorl_msgs::fields::Visitor;
use whorl_node::Timestamp;

/// Smaller differences between two readings are those of reading two clocks one after the other \[ns\]. Both clocks are
/// slewed alike, so nothing else makes them differ but somebody who sets one.
const SAME_NS: i64 = 1_000_000;
/// The two clocks are compared only when reading both took no longer than this.
const QUICK: Duration = Duration::from_micros(100);

/// A clock that is set back by more than this makes a connection useless: until the time of day is where it was, RustDDS 0.15
/// hands out no best-effort sample (`dds_cache.rs`, `get_changes_in_range`). Join the network anew.
pub const SET_BACK: Duration = Duration::from_millis(50);

/// A node's time, and what the computer's clock was set by since it began.
#[derive(Debug, Clone)]
pub struct Clock {
    /// Node's time less monotonic time \[ns\].
    origin_ns: i64,
    /// Time of day less node's time \[ns\].
    set_by_ns: i64,
    /// What it was set by and nobody has asked for yet \[ns\].
    unreported_ns: i64,
}

/// A computer's clock was set by this much \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClockStep(i64);

impl ClockStep {
    /// Whether connections have become useless; see [`SET_BACK`].
    #[must_use]
    pub fn needs_rejoining(self) -> bool {
        i128::from(self.0) < -(SET_BACK.as_nanos() as i128)
    }
}

impl fmt::Display for ClockStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "this computer's clock was set by {:+.3} s", self.0 as f64 * 1e-9)
    }
}

impl Default for Clock {
    fn default() -> Self {
        let (monotonic, wall) = (monotonic(), wall_clock());
        Self { origin_ns: wall.0.saturating_sub(nanoseconds(monotonic)), set_by_ns: 0, unreported_ns: 0 }
    }
}

impl Clock {
    /// The node's time now.
    pub fn now(&mut self) -> Timestamp {
        let (before, wall) = (monotonic(), wall_clock());
        let after = monotonic();
        self.advance(after, (after - before <= QUICK).then_some(wall))
    }

    /// The node's time now, and the instant of it: whoever waits for devices counts in instants.
    pub fn reading(&mut self) -> (Timestamp, Instant) {
        let instant = Instant::now();
        (self.now(), instant)
    }

    /// The node's time at this monotonic time, at which the time of day is `wall`.
    fn advance(&mut self, monotonic: Duration, wall: Option<Timestamp>) -> Timestamp {
        let now = Timestamp(self.origin_ns.saturating_add(nanoseconds(monotonic)));
        if let Some(wall) = wall {
            let set_by_ns = wall.0.saturating_sub(now.0);
            let change_ns = set_by_ns.saturating_sub(self.set_by_ns);
            if change_ns.saturating_abs() > SAME_NS {
                self.unreported_ns = self.unreported_ns.saturating_add(change_ns);
                self.set_by_ns = set_by_ns;
            }
        }
        now
    }

    /// What the computer's clock was set by since the last call; `None`: it was not.
    pub fn take_step(&mut self) -> Option<ClockStep> {
        Some(std::mem::take(&mut self.unreported_ns)).filter(|step| *step != 0).map(ClockStep)
    }

    /// The node's time when the time of day was `at`, which was not long ago. What came before the clock was set and is
    /// looked at after it came just now.
    pub fn own_time(&mut self, at: Timestamp) -> Timestamp {
        let now = self.now();
        let own = Timestamp(at.0.saturating_sub(self.set_by_ns));
        if (0.0..1.0).contains(&now.seconds_since(own)) { own } else { now }
    }

    /// The stamps of a message that came in, by the time of day, become node's time.
    pub fn to_own(&self, message: &mut Message) {
        self.shift(message, self.set_by_ns.saturating_neg());
    }

    /// The stamps of a message that goes out become the time of day.
    pub fn to_time_of_day(&self, message: &mut Message) {
        self.shift(message, self.set_by_ns);
    }

    /// The time of day at an instant of the node's time.
    pub fn time_of_day(&self, at: Timestamp) -> Timestamp {
        Timestamp(at.0.saturating_add(self.set_by_ns))
    }

    fn shift(&self, message: &mut Message, by_ns: i64) {
        if by_ns != 0 {
            message.walk(&mut Shift(by_ns));
        }
    }
}

/// Moves every stamp; one that is zero says that there is none.
struct Shift(i64);

impl Visitor for Shift {
    fn time(&mut self, _name: &'static str, value: &mut Time) {
        if *value != Time::default() {
            *value = Timestamp(Timestamp::from(*value).0.saturating_add(self.0)).into();
        }
    }
}

fn nanoseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
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

    const SECOND: i64 = 1_000_000_000;

    fn clock() -> Clock {
        // Started at 1000 s of the time of day, 10 s after the computer.
        Clock { origin_ns: 990 * SECOND, set_by_ns: 0, unreported_ns: 0 }
    }

    #[test]
    fn time_runs_on_whatever_the_time_of_day_is_set_to() {
        let mut clock = clock();
        let mut at = |monotonic_s: u64, wall_s: i64| {
            let now = clock.advance(Duration::from_secs(monotonic_s), Some(Timestamp(wall_s * SECOND)));
            (now.0 / SECOND, clock.take_step().map(|ClockStep(step)| step / SECOND))
        };
        assert_eq!(at(11, 1001), (1001, None));
        assert_eq!(at(12, 942), (1002, Some(-60)));
        assert_eq!(at(13, 943), (1003, None));
        assert_eq!(at(14, 1064), (1004, Some(120)));
        assert_eq!(at(15, 1005), (1005, Some(-60)));
    }

    #[test]
    fn clocks_that_could_not_be_read_together_are_not_compared() {
        let mut clock = clock();
        assert_eq!(clock.advance(Duration::from_secs(11), None), Timestamp(1001 * SECOND));
        let wall = Timestamp(1002 * SECOND + SAME_NS);
        assert_eq!(clock.advance(Duration::from_secs(12), Some(wall)), Timestamp(1002 * SECOND));
        assert_eq!(clock.take_step(), None);
    }

    #[test]
    fn others_see_the_time_of_day_and_the_node_its_own() {
        use whorl_msgs::whorl::ActuatorCommand;
        let mut clock = clock();
        let time = |seconds: i64| Time::from(Timestamp(seconds * SECOND));
        let command = |stamp: i64, until: i64| {
            let mut command = ActuatorCommand { valid_until: time(until), ..ActuatorCommand::default() };
            command.header.stamp = time(stamp);
            Message::from(command)
        };
        let mut message = command(1002, 1003);
        clock.to_time_of_day(&mut message);
        assert_eq!(message, command(1002, 1003));
        clock.advance(Duration::from_secs(12), Some(Timestamp(942 * SECOND)));
        clock.to_time_of_day(&mut message);
        assert_eq!(message, command(942, 943));
        assert_eq!(clock.time_of_day(Timestamp(1002 * SECOND)), Timestamp(942 * SECOND));
        clock.to_own(&mut message);
        assert_eq!(message, command(1002, 1003));
        // A stamp that was never set stays so.
        let mut unset = command(0, 0);
        clock.to_time_of_day(&mut unset);
        assert_eq!(unset, command(0, 0));
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
