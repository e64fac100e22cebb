//! Time as nodes see it.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

use whorl_msgs::builtin_interfaces::Time;

/// Nanoseconds since the ROS epoch (1970-01-01 UTC in real time, 0 = start in simulation).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// The instant `seconds` after the epoch, rounded to a nanosecond.
    #[must_use]
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Seconds since the epoch. Loses nanoseconds for present-day wall times: use
    /// [`Self::seconds_since`] for intervals.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Seconds from `earlier` to `self`; negative when `self` is earlier.
    #[must_use]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }
}

impl Add<Duration> for Timestamp {
    type Output = Self;
    fn add(self, rhs: Duration) -> Self {
        Self(self.0.saturating_add(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX)))
    }
}

impl Sub<Duration> for Timestamp {
    type Output = Self;
    fn sub(self, rhs: Duration) -> Self {
        Self(self.0.saturating_sub(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX)))
    }
}

impl From<Time> for Timestamp {
    fn from(time: Time) -> Self {
        Self(i64::from(time.sec) * 1_000_000_000 + i64::from(time.nanosec))
    }
}

impl From<Timestamp> for Time {
    fn from(stamp: Timestamp) -> Self {
        // `builtin_interfaces/Time` counts whole seconds towards minus infinity, so that
        // `nanosec` is never negative; `sec` is 32 bits wide by definition of the message.
        Self {
            sec: i32::try_from(stamp.0.div_euclid(1_000_000_000)).unwrap_or(i32::MAX),
            nanosec: stamp.0.rem_euclid(1_000_000_000) as u32,
        }
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:09} s", self.0.div_euclid(1_000_000_000), self.0.rem_euclid(1_000_000_000))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_time_survives_the_round_trip_also_before_the_epoch() {
        for ns in [0, 1, 999_999_999, 1_000_000_000, 1_700_000_000_123_456_789, -1, -1_500_000_000] {
            assert_eq!(Timestamp::from(Time::from(Timestamp(ns))), Timestamp(ns));
        }
        assert_eq!(Time::from(Timestamp(-1)), Time { sec: -1, nanosec: 999_999_999 });
    }
}
