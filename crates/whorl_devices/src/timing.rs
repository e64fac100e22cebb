//! When a sample was taken, from the device's clock and the arrival of its messages.

use std::time::{Duration, Instant};

/// Crystals of device and computer agree within this.
const DRIFT: f64 = 1e-4;
/// A device's clock that is so far from where it was expected has been started again.
const RESTART_S: f64 = 1.0;

/// Translates the clock of a device to that of this computer. Messages come late now and then, never early: the smallest
/// delay seen is the usual one, and it may grow only as fast as clocks drift apart.
#[derive(Debug, Clone, Default)]
pub(crate) struct DeviceClock {
    /// Computer time at which the device's clock showed zero, and device time of the message that said so.
    origin: Option<(Instant, f64)>,
}

impl DeviceClock {
    /// The instant at which the device's clock showed `device_s`, of which a message says that arrived at `arrival` after
    /// a usual delay.
    pub(crate) fn instant(&mut self, device_s: f64, arrival: Instant, usual_delay: Duration) -> Instant {
        let seen = (|| arrival.checked_sub(usual_delay)?.checked_sub(seconds(device_s)?))();
        // A computer that has run for less time than the device.
        let Some(seen) = seen else { return arrival.checked_sub(usual_delay).unwrap_or(arrival) };
        let origin = match self.origin {
            Some((origin, at_s)) => {
                let later = seconds((device_s - at_s).max(0.0) * DRIFT).unwrap_or_default();
                let away = seen.saturating_duration_since(origin).max(origin.saturating_duration_since(seen));
                let restarted = device_s < at_s || away.as_secs_f64() > RESTART_S;
                if restarted { seen } else { seen.min(origin + later) }
            }
            None => seen,
        };
        self.origin = Some((origin, device_s));
        seconds(device_s).map_or(arrival, |since| origin + since).min(arrival)
    }
}

fn seconds(s: f64) -> Option<Duration> {
    Duration::try_from_secs_f64(s).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_messages_get_the_time_of_their_sample() {
        let begin = Instant::now() + Duration::from_secs(1000);
        let delay = Duration::from_micros(630);
        let mut clock = DeviceClock::default();
        for k in 0..1000_u64 {
            // 40 ppm slow, every third message late by up to 20 ms.
            let taken_s = k as f64 * 0.01;
            let late = if k % 3 == 2 { Duration::from_millis(k % 20) } else { Duration::ZERO };
            let taken = begin + Duration::from_secs_f64(taken_s);
            let at = clock.instant(5.0 + taken_s * (1.0 - 4e-5), taken + delay + late, delay);
            let off = at.saturating_duration_since(taken).max(taken.saturating_duration_since(at));
            assert!(off < Duration::from_micros(5), "{k}: {off:?}");
        }
        // Unplugged and back: its clock begins again.
        let later = begin + Duration::from_secs(60);
        let at = clock.instant(0.5, later + delay, delay);
        assert_eq!(at, later);
    }
}
