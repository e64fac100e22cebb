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
    #[inline]
    pub fn from_seconds(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Seconds since the epoch. Loses nanoseconds for present-day wall times: use
    /// [`Self::seconds_since`] for intervals.
    #[must_use]
    #[inline]
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Seconds from `earlier` to `self`; negative when `self` is earlier.
    #[must_use]
    #[inline]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }
}

impl Add<Duration> for Timestamp {
    type Output = Self;
    #[inline]
    fn add(self, rhs: Duration) -> Self {
        Self(self.0.saturating_add(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX)))
    }
}

impl Sub<Duration> for Timestamp {
    type Output = Self;
    #[inline]
    fn sub(self, rhs: Duration) -> Self {
        Self(self.0.saturating_sub(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX)))
    }
}

/// `builtin_interfaces/Time` has 32 bits for the seconds, which end on 2038-01-19. They are taken to wrap around: what would be
/// more than 2^30 s before 1970 (before 1935) is 2^32 s later, up to 2072.
const FIRST_S: i64 = -(1 << 30);
const WRAP_S: i64 = 1 << 32;

impl From<Time> for Timestamp {
    #[inline]
    fn from(time: Time) -> Self {
        let sec = i64::from(time.sec);
        let sec = if sec < FIRST_S { sec + WRAP_S } else { sec };
        Self(sec * 1_000_000_000 + i64::from(time.nanosec))
    }
}

impl From<Timestamp> for Time {
    #[inline]
    fn from(stamp: Timestamp) -> Self {
        // `builtin_interfaces/Time` counts whole seconds towards minus infinity, so that
        // `nanosec` is never negative; `sec` is 32 bits wide by definition of the message.
        let sec = stamp.0.div_euclid(1_000_000_000).clamp(FIRST_S, FIRST_S + WRAP_S - 1);
        Self {
            sec: i32::try_from(sec).or_else(|_| i32::try_from(sec - WRAP_S)).unwrap_or(i32::MAX),
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

    #[test]
    fn message_time_goes_on_after_2038() {
        // 2038-01-19T03:14:07Z is the last second of 31 bits; 2072-01-01T00:00:00Z is 3_218_832_000 (date -u +%s).
        for s in [i64::from(i32::MAX), 1 << 31, (1 << 31) + 1, 3_218_832_000] {
            let stamp = Timestamp(s * 1_000_000_000 + 5);
            assert_eq!(Timestamp::from(Time::from(stamp)), stamp, "{s}");
        }
        assert_eq!(Time::from(Timestamp((1 << 31) * 1_000_000_000)).sec, i32::MIN);
        // Beyond, it stands still.
        let end = Timestamp(FIRST_S * 1_000_000_000 + WRAP_S * 1_000_000_000 - 1);
        assert_eq!(Timestamp::from(Time::from(Timestamp(i64::MAX))).0 / 1_000_000_000, end.0 / 1_000_000_000);
    }
}
