//! Up to when everything is known that a cell needs, and what of it is late, lost or in disorder.
//!
//! A computer that has too much to do delivers late, and not every topic equally late. A cell is predicted only when every
//! source has reached its end; where something is missing for good the motion is unknown, and nothing is concluded from it.

/// Messages further apart are a gap \[s\], unless the source is always that slow.
const GAP_S: f64 = 0.05;
/// What local control says may be further apart \[s\]: it moves nothing itself, and a hand is not faster.
const CONTROL_GAP_S: f64 = 0.25;
/// A source is always that slow where its messages are usually more than a part of this apart.
const USUALLY: f64 = 3.0;
/// How fast the usual distance is learned: over some so many messages.
const LEARNED_IN: f64 = 32.0;
/// Nobody waits longer for a source, while others go on \[s\].
const WAITS_S: f64 = 2.0;

/// What comes regularly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    Gyro,
    Attitude,
    Control,
    Wheels,
    Valves,
}

impl Source {
    const ALL: [Self; 5] = [Self::Gyro, Self::Attitude, Self::Control, Self::Wheels, Self::Valves];
    const NAMES: [&str; 5] = [
        "readings of the gyro",
        "attitude estimates",
        "states of local control",
        "states of the wheels",
        "states of the valves",
    ];

    /// What is wrong with it.
    fn hole(self, why: &str) -> String {
        format!("{} {why}", Self::NAMES[self as usize])
    }
}

/// One source.
#[derive(Debug, Clone, Copy, Default)]
struct Stream {
    newest_ns: Option<i64>,
    usual_s: Option<f64>,
    /// Nobody has it on this platform.
    absent: bool,
}

/// All sources.
#[derive(Debug, Clone)]
pub(crate) struct Sources {
    streams: [Stream; 5],
}

impl Sources {
    /// Of a platform with or without wheels and jets.
    pub fn new(wheels: bool, jets: bool) -> Self {
        let mut streams = [Stream::default(); 5];
        streams[Source::Wheels as usize].absent = !wheels;
        streams[Source::Valves as usize].absent = !jets;
        Self { streams }
    }

    /// Nothing is known until now.
    pub fn forget(&mut self) {
        self.streams.iter_mut().for_each(|stream| stream.newest_ns = None);
    }

    /// A message; the time since the one before \[s\], `None` for the first after a hole.
    ///
    /// # Errors
    /// A gap, or a message that is not newer than the one before.
    pub fn heard(&mut self, source: Source, stamp_ns: i64) -> Result<Option<f64>, String> {
        let stream = &mut self.streams[source as usize];
        let Some(before) = stream.newest_ns.replace(stamp_ns) else { return Ok(None) };
        if stamp_ns <= before {
            // Control acts on estimates, and may act on one twice.
            if source == Source::Control {
                stream.newest_ns = Some(before);
                return Ok(None);
            }
            return Err(source.hole("came in disorder"));
        }
        let since_s = stamp_ns.saturating_sub(before) as f64 * 1e-9;
        // Gaps are not usual, however many.
        let usual_s = stream.usual_s.get_or_insert(since_s.min(GAP_S));
        let least_s = if source == Source::Control { CONTROL_GAP_S } else { GAP_S };
        let gap_s = least_s.max(USUALLY * *usual_s);
        *usual_s += (since_s.min(2.0 * *usual_s) - *usual_s) / LEARNED_IN;
        if since_s > gap_s { Err(source.hole("were late or lost")) } else { Ok(Some(since_s)) }
    }

    /// Whether everything is known until `until_ns`.
    ///
    /// # Errors
    /// A source that is silent while others go on.
    pub fn complete(&self, until_ns: i64) -> Result<bool, String> {
        let present = || Source::ALL.into_iter().filter(|source| !self.streams[*source as usize].absent);
        let newest_ns = |source: Source| self.streams[source as usize].newest_ns;
        let late = |source: &Source| newest_ns(*source).is_none_or(|newest| newest < until_ns);
        let Some(missing) = present().find(late) else { return Ok(true) };
        let newest = present().filter_map(newest_ns).max().unwrap_or(until_ns);
        let is_silent = newest.saturating_sub(until_ns) as f64 * 1e-9 > WAITS_S;
        if is_silent { Err(missing.hole("are missing")) } else { Ok(false) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// Streams of 100 Hz that have all reached `ms`.
    fn all_until(ms: i64) -> Sources {
        let mut sources = Sources::new(true, true);
        for at in (0..=ms).step_by(10) {
            for source in Source::ALL {
                sources.heard(source, at * MS).unwrap();
            }
        }
        sources
    }

    #[test]
    fn an_interval_is_complete_when_every_source_has_reached_its_end() {
        let mut sources = all_until(1000);
        assert_eq!(sources.complete(1000 * MS), Ok(true));
        assert_eq!(sources.complete(1010 * MS), Ok(false));
        for source in Source::ALL.into_iter().filter(|source| *source != Source::Valves) {
            for at in (1010..=3100).step_by(10) {
                sources.heard(source, at * MS).unwrap();
            }
        }
        assert_eq!(sources.complete(1200 * MS), Ok(false));
        assert_eq!(sources.complete(1050 * MS), Err(Source::Valves.hole("are missing")));
        // A platform without jets has no valves to wait for.
        let mut sources = Sources::new(false, false);
        for source in [Source::Gyro, Source::Attitude, Source::Control] {
            sources.heard(source, 5 * MS).unwrap();
        }
        assert_eq!(sources.complete(5 * MS), Ok(true));
    }

    #[test]
    fn gaps_and_disorder_are_found_and_slow_sources_are_not_gaps() {
        let mut sources = all_until(1000);
        assert_eq!(sources.heard(Source::Wheels, 1040 * MS).unwrap(), Some(0.04));
        assert_eq!(sources.heard(Source::Wheels, 1040 * MS), Err(Source::Wheels.hole("came in disorder")));
        assert_eq!(sources.heard(Source::Gyro, 900 * MS), Err(Source::Gyro.hole("came in disorder")));
        assert_eq!(sources.heard(Source::Valves, 1080 * MS), Err(Source::Valves.hole("were late or lost")));
        assert_eq!(sources.heard(Source::Control, 1200 * MS).unwrap(), Some(0.2));
        sources.forget();
        assert_eq!(sources.heard(Source::Wheels, 0).unwrap(), None, "the first after a hole");
        // Drives that answer 15 times a second.
        let mut slow = Sources::new(true, false);
        for at in (0..2000).step_by(66) {
            assert!(slow.heard(Source::Wheels, at * MS).is_ok(), "{at}");
        }
    }
}
