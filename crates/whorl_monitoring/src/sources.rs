//! Up to when everything is known that a bin needs, and what of it is late, lost or in disorder.
//!
//! A computer that has too much to do delivers late, and not every topic equally late. A bin is predicted only when every
//! source has reached its end; where something is missing for good the motion is unknown, and nothing is concluded from it.

use std::fmt;

use whorl_dynamics::gyrostat::MAX_WHEELS;

/// Messages further apart are a gap \[s\], unless the source is always that slow.
pub(crate) const GAP_S: f64 = 0.05;
/// What local control says may be further apart \[s\]: it moves nothing itself, and a hand is not faster.
const CONTROL_GAP_S: f64 = 0.25;
/// A source is always that slow where its messages are usually more than a part of this apart.
const USUALLY: f64 = 3.0;
/// Messages so much further apart than usual are late, or one between them is lost.
const LATE: f64 = 1.5;
/// How fast the usual distance is learned, and the usual change of torque: over some so many messages.
const LEARNED_IN: f64 = 32.0;
/// Nobody waits longer for a source, while others go on \[s\].
const WAITS_S: f64 = 2.0;

/// What comes regularly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Readings of the gyro.
    Gyro,
    /// Estimates of the attitude.
    Attitude,
    /// That the platform is controlled.
    Control,
    /// Speeds and torques of the wheels.
    Wheels,
    /// States of the valves.
    Valves,
}

impl Source {
    const ALL: [Self; 5] = [Self::Gyro, Self::Attitude, Self::Control, Self::Wheels, Self::Valves];

    fn name(self) -> &'static str {
        match self {
            Self::Gyro => "readings of the gyro",
            Self::Attitude => "attitude estimates",
            Self::Control => "states of local control",
            Self::Wheels => "states of the wheels",
            Self::Valves => "states of the valves",
        }
    }
}

/// Why the motion is not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hole {
    /// Messages are too far apart.
    Gap(Source),
    /// A message is not newer than the one before.
    Disorder(Source),
    /// A source is silent while others go on.
    Silent(Source),
    /// What messages of a source say of the same cannot be.
    Contradiction(Source),
    /// What arrived belongs to a time that has been compared already.
    Late,
    /// More data wait than are kept.
    TooMany,
    /// Jets are open, and nobody knows whether there is gas.
    Gas,
}

impl fmt::Display for Hole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gap(source) => write!(f, "{} were late or lost", source.name()),
            Self::Disorder(source) => write!(f, "{} came in disorder", source.name()),
            Self::Silent(source) => write!(f, "{} are missing", source.name()),
            Self::Contradiction(source) => write!(f, "{} contradict each other", source.name()),
            Self::Late => f.write_str("data came too late"),
            Self::TooMany => f.write_str("data came faster than they could be compared"),
            Self::Gas => f.write_str("the tank is nearly empty, and jets may push or not"),
        }
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

    /// Stamp of the newest message.
    pub fn newest_ns(&self, source: Source) -> Option<i64> {
        self.streams[source as usize].newest_ns
    }

    /// Usual time between messages \[s\].
    pub fn usual_s(&self, source: Source) -> Option<f64> {
        self.streams[source as usize].usual_s
    }

    /// A message; the time since the one before \[s\], `None` for the first after a hole.
    ///
    /// # Errors
    /// A gap, or a message that is not newer than the one before.
    pub fn heard(&mut self, source: Source, stamp_ns: i64) -> Result<Option<f64>, Hole> {
        let stream = &mut self.streams[source as usize];
        let Some(before) = stream.newest_ns.replace(stamp_ns) else { return Ok(None) };
        if stamp_ns <= before {
            return Err(Hole::Disorder(source));
        }
        let since_s = stamp_ns.saturating_sub(before) as f64 * 1e-9;
        // Gaps are not usual, however many.
        let usual_s = stream.usual_s.get_or_insert(since_s.min(GAP_S));
        let least_s = if source == Source::Control { CONTROL_GAP_S } else { GAP_S };
        let gap_s = least_s.max(USUALLY * *usual_s);
        *usual_s += (since_s.min(2.0 * *usual_s) - *usual_s) / LEARNED_IN;
        if since_s > gap_s { Err(Hole::Gap(source)) } else { Ok(Some(since_s)) }
    }

    /// Whether everything is known until `until_ns`.
    ///
    /// # Errors
    /// A source that is silent while others go on.
    pub fn complete(&self, until_ns: i64) -> Result<bool, Hole> {
        let present = || Source::ALL.into_iter().filter(|source| !self.streams[*source as usize].absent);
        let late = |source: &Source| self.newest_ns(*source).is_none_or(|newest| newest < until_ns);
        let Some(missing) = present().find(late) else { return Ok(true) };
        let newest = present().filter_map(|source| self.newest_ns(source)).max().unwrap_or(until_ns);
        match newest.saturating_sub(until_ns) as f64 * 1e-9 > WAITS_S {
            true => Err(Hole::Silent(missing)),
            false => Ok(false),
        }
    }
}

/// What the motors of the wheels did between messages.
#[derive(Debug, Clone, Default)]
pub(crate) struct WheelTorque {
    before_n_m: [f64; MAX_WHEELS],
    /// Mean square of what a torque changes from a message to the next [(N m)^2].
    usual_change: [f64; MAX_WHEELS],
}

impl WheelTorque {
    /// Nothing is known of the time before.
    pub fn is(&mut self, torque_n_m: &[f64; MAX_WHEELS]) {
        self.before_n_m = *torque_n_m;
    }

    /// A torque took force at some time since the message before: variance of the impulse if it is taken to have been in force
    /// all the time [(N m s)^2]. Where the message is late others may be lost, and what they would have said.
    pub fn took_force(
        &mut self,
        torque_n_m: &[f64; MAX_WHEELS],
        since_s: f64,
        usual_s: Option<f64>,
    ) -> [f64; MAX_WHEELS] {
        let late = usual_s.is_some_and(|usual_s| since_s > LATE * usual_s);
        let mut variance = [0.0; MAX_WHEELS];
        let wheels = torque_n_m.iter().zip(&mut self.before_n_m).zip(&mut self.usual_change);
        for (variance, ((now, before), usual)) in variance.iter_mut().zip(wheels) {
            let change = (now - *before).powi(2);
            // Uniform over the interval: a third of its square.
            *variance = (change + if late { *usual } else { 0.0 }) * since_s * since_s / 3.0;
            if !late {
                *usual += (change - *usual) / LEARNED_IN;
            }
            *before = *now;
        }
        variance
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
        assert_eq!(sources.complete(1050 * MS), Err(Hole::Silent(Source::Valves)));
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
        assert_eq!(sources.heard(Source::Wheels, 1040 * MS), Err(Hole::Disorder(Source::Wheels)));
        assert_eq!(sources.heard(Source::Gyro, 900 * MS), Err(Hole::Disorder(Source::Gyro)));
        assert_eq!(sources.heard(Source::Valves, 1080 * MS), Err(Hole::Gap(Source::Valves)));
        assert_eq!(sources.heard(Source::Control, 1200 * MS).unwrap(), Some(0.2));
        sources.forget();
        assert_eq!(sources.heard(Source::Wheels, 0).unwrap(), None, "the first after a hole");
        // Drives that answer 15 times a second.
        let mut slow = Sources::new(true, false);
        for at in (0..2000).step_by(66) {
            assert!(slow.heard(Source::Wheels, at * MS).is_ok(), "{at}");
        }
    }

    /// A torque that changed by 0.1 N m at some time in 20 ms: 0.1 * 0.02 N m s, uniform.
    #[test]
    fn a_torque_is_uncertain_by_when_it_took_force() {
        let mut torque = WheelTorque::default();
        let of = |x: f64| [x; MAX_WHEELS];
        torque.is(&of(0.1));
        assert_eq!(torque.took_force(&of(0.1), 0.01, Some(0.01))[0], 0.0);
        let variance = torque.took_force(&of(0.2), 0.01, Some(0.01))[0];
        assert!((variance - (0.1_f64 * 0.01).powi(2) / 3.0).abs() < 1e-12);
        // Late, and nothing has changed: one that is lost may have said something else.
        assert!(torque.took_force(&of(0.2), 0.03, Some(0.01))[0] > 0.0);
    }
}
