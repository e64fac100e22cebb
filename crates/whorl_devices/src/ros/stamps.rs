//! When a sample was taken, from the stamp of its message.

use std::time::{Duration, Instant};

use whorl_node::Timestamp;
use whorl_params::{Reader, range};

use crate::timing::DeviceClock;

/// Clocks that are set by chrony or PTP agree much better.
const AHEAD_S: f64 = 0.005;
/// Older samples are of no use.
const OLDEST_S: f64 = 0.25;

/// Whose clock stamps are of.
#[derive(Debug, Clone)]
enum Clock {
    /// This computer's, or one that is kept the same.
    Computer,
    /// One of its own: the quickest message took so long.
    Own { usual: Duration, began: Option<Timestamp>, clock: DeviceClock },
}

/// Translates stamps. One for each session.
#[derive(Debug, Clone)]
pub(super) struct Stamps {
    clock: Clock,
    last: Option<Timestamp>,
}

impl Stamps {
    pub(super) fn read(r: &mut Reader<'_>) -> Self {
        let clock = r.choice_or(
            "clock",
            "computer",
            &["computer", "own"],
            "whose clock the stamps are of: this computer's or one kept the same (chrony, PTP), or one of its own",
        );
        let latency_s = r.f64_or(
            "latency_s",
            0.0,
            range(0.0..=0.2),
            "with clock own: from a sample to the quickest arrival of its message [s]",
        );
        let usual = Duration::from_secs_f64(latency_s);
        let own = Clock::Own { usual, began: None, clock: DeviceClock::default() };
        Self { clock: if clock == "own" { own } else { Clock::Computer }, last: None }
    }

    /// The instant of a sample of this stamp, which has just arrived, at this time of day.
    ///
    /// # Errors
    /// Why there is none, for people.
    pub(super) fn instant(
        &mut self,
        stamp: Timestamp,
        arrival: Instant,
        now: Timestamp,
    ) -> Result<Instant, String> {
        let instant = match &mut self.clock {
            Clock::Computer => {
                let age_s = now.seconds_since(stamp);
                if !(-AHEAD_S..=OLDEST_S).contains(&age_s) {
                    let which = if age_s > 0.0 { "behind" } else { "ahead of" };
                    return Err(format!(
                        "its stamps are {:.3} s {which} this computer's clock: keep the clocks the same (chrony, PTP), or \
                         set clock: own",
                        age_s.abs()
                    ));
                }
                arrival - Duration::from_secs_f64(age_s.max(0.0))
            }
            Clock::Own { usual, began, clock } => {
                let first = began.get_or_insert(stamp);
                if stamp < *first {
                    *first = stamp;
                }
                clock.instant(stamp.seconds_since(*first), arrival, *usual)
            }
        };
        // Clocks of its own may be set back, and are then followed.
        if matches!(self.clock, Clock::Computer) && self.last.is_some_and(|last| stamp <= last) {
            return Err("its stamps do not grow".to_owned());
        }
        self.last = Some(stamp);
        Ok(instant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(clock: Clock) -> Stamps {
        Stamps { clock, last: None }
    }

    #[test]
    fn stamps_of_this_computer_tell_the_age_and_wrong_ones_are_refused_in_words() {
        let arrival = Instant::now() + Duration::from_secs(100);
        let now = Timestamp::from_seconds(1000.0);
        let mut own = stamps(Clock::Computer);
        let at = own.instant(Timestamp::from_seconds(999.98), arrival, now).unwrap();
        let age = arrival.saturating_duration_since(at).as_secs_f64();
        assert!((age - 0.02).abs() < 1e-6, "{age}");
        assert!(
            own.instant(Timestamp::from_seconds(999.98), arrival, now).unwrap_err().contains("do not grow")
        );
        // A little ahead is a clock that is a little ahead.
        assert_eq!(own.instant(Timestamp::from_seconds(1000.002), arrival, now), Ok(arrival));
        let behind = own.instant(Timestamp::from_seconds(990.0), arrival, now).unwrap_err();
        assert!(behind.contains("10.000 s behind") && behind.contains("clock: own"), "{behind}");
        let ahead = own.instant(Timestamp::from_seconds(1001.0), arrival, now).unwrap_err();
        assert!(ahead.contains("1.000 s ahead of"), "{ahead}");
    }

    #[test]
    fn a_clock_of_its_own_is_translated_by_the_quickest_message() {
        let begin = Instant::now() + Duration::from_secs(100);
        let usual = Duration::from_millis(3);
        let mut own = stamps(Clock::Own { usual, began: None, clock: DeviceClock::default() });
        for k in 0..200_u64 {
            let taken = begin + Duration::from_millis(10 * k);
            let late = Duration::from_millis(if k % 4 == 1 { k % 9 } else { 0 });
            let stamp = Timestamp(86_400_000_000_000 + i64::try_from(k).unwrap() * 10_000_000);
            let at = own.instant(stamp, taken + usual + late, Timestamp(0)).unwrap();
            let off = at.saturating_duration_since(taken).max(taken.saturating_duration_since(at));
            assert!(off < Duration::from_micros(20), "{k}: {off:?}");
        }
        // Set to another day: followed from there.
        let later = begin + Duration::from_secs(20);
        assert_eq!(own.instant(Timestamp(5_000_000_000), later + usual, Timestamp(0)), Ok(later));
    }
}
