//! The settings of laws, independent of where they are stored.
//!
//! A law reads its own settings ([`super::RelativeAttitudeLaw::read`]) and knows their names, ranges, defaults and docs.
//! It does not depend on the format of parameter files. Keys are relative to the group that is open; the outermost is the formation's, in
//! which every law has a group of its name, and every platform one below `members`.

use std::ops::Bound;

use nalgebra::{Unit, Vector3};
use thiserror::Error;

use super::ReferenceLimits;

/// Share of the tightest platform's limits that a law's own motion uses by default: its members need the rest to catch up.
const STRUCTURE_SHARE: f64 = 0.8;

/// Numbers that a setting may have: within the bounds, and finite unless it says otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allowed {
    /// Smallest.
    pub lower: Bound<f64>,
    /// Largest.
    pub upper: Bound<f64>,
    /// Infinity is allowed too.
    pub or_infinite: bool,
}

impl Allowed {
    /// Above zero.
    pub const POSITIVE: Self =
        Self { lower: Bound::Excluded(0.0), upper: Bound::Unbounded, or_infinite: false };
    /// At least zero.
    pub const NON_NEGATIVE: Self =
        Self { lower: Bound::Included(0.0), upper: Bound::Unbounded, or_infinite: false };

    /// From `lower` to `upper`, both included.
    #[must_use]
    pub const fn between(lower: f64, upper: f64) -> Self {
        Self { lower: Bound::Included(lower), upper: Bound::Included(upper), or_infinite: false }
    }

    /// At least `lower`; infinity too.
    #[must_use]
    pub const fn at_least_or_infinite(lower: f64) -> Self {
        Self { lower: Bound::Included(lower), upper: Bound::Unbounded, or_infinite: true }
    }
}

/// Who is in the formation: available to a law while it reads its settings. All slices are in the order of platforms.
#[derive(Debug, Clone, Copy)]
pub struct Roster<'a> {
    /// Names of the platforms.
    pub platforms: &'a [String],
    /// What each platform's reference may do; empty when that was refused.
    pub limits: &'a [ReferenceLimits],
}

impl Roster<'_> {
    /// How many platforms.
    #[must_use]
    pub fn len(&self) -> usize {
        self.platforms.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.platforms.is_empty()
    }

    /// Every platform but one.
    pub(super) fn others(&self, platform: usize) -> Vec<usize> {
        (0..self.len()).filter(|other| *other != platform).collect()
    }

    /// The platforms before and after one, all in a ring.
    pub(super) fn beside(&self, platform: usize) -> Vec<usize> {
        let count = self.len();
        let mut beside = vec![(platform + count - 1) % count.max(1), (platform + 1) % count.max(1)];
        beside.dedup();
        beside.retain(|other| *other != platform);
        beside
    }
}

/// Why a law was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum LawError {
    /// A gain outside its proven range.
    #[error("{law}: {gain} = {value} must be {allowed}")]
    Gain {
        /// The law.
        law: &'static str,
        /// Which gain.
        gain: &'static str,
        /// As given.
        value: f64,
        /// The bound, in words.
        allowed: String,
    },
    /// A neighbour that does not see the platform as its own neighbour.
    #[error(
        "{law}: platform {platform} keeps formation with platform {neighbour}, but not the other way round: neighbours must be mutual"
    )]
    NotMutual {
        /// The law.
        law: &'static str,
        /// Who names a neighbour.
        platform: usize,
        /// Who does not name it.
        neighbour: usize,
    },
}

/// The source of settings. Every read gives a value, a harmless one after an error, which the source keeps and reports.
pub trait Settings {
    /// Opens a group: keys are relative to it until [`Self::leave`]. Laws open groups with `group`.
    fn enter(&mut self, group: &str);

    /// Closes the group that was opened last.
    fn leave(&mut self);

    /// Whether a value, or a group with at least one value, is given.
    fn has(&self, key: &str) -> bool;

    /// A number that must be given.
    fn number(&mut self, key: &str, allowed: Allowed, doc: &str) -> f64;

    /// A number with a default.
    fn number_or(&mut self, key: &str, default: f64, allowed: Allowed, doc: &str) -> f64;

    /// A direction that must be given: three numbers, not all zero.
    fn direction(&mut self, key: &str, doc: &str) -> Unit<Vector3<f64>>;

    /// The index of a platform that is given by its name; an empty name is `None`.
    fn platform_or(&mut self, key: &str, default: Option<usize>, doc: &str) -> Option<usize>;

    /// The indices of platforms that are given by their names; `None` when the key is left out.
    fn optional_platforms(&mut self, key: &str, doc: &str) -> Option<Vec<usize>>;

    /// Refuses what was given for a key, or a whole group. `problem` says what is wrong and what is allowed; platforms in it
    /// are "platform 0" or "platforms [0, 1]".
    fn reject(&mut self, key: &str, problem: String);
}

impl dyn Settings + '_ {
    /// Reads inside a group.
    pub fn group<T>(&mut self, name: &str, read: impl FnOnce(&mut dyn Settings) -> T) -> T {
        self.enter(name);
        let value = read(self);
        self.leave();
        value
    }

    /// Reads for each platform, inside its group.
    pub(super) fn members<T>(
        &mut self,
        roster: &Roster<'_>,
        mut read: impl FnMut(&mut dyn Settings, usize) -> T,
    ) -> Vec<T> {
        let each = roster.platforms.iter().enumerate();
        each.map(|(index, name)| self.group(&format!("members.{name}"), |s| read(s, index))).collect()
    }

    /// The law, or `None` after refusing the setting that is wrong: the gain that was named if it was given, else `key`.
    pub(super) fn accept<T>(&mut self, law: Result<T, LawError>, key: &str) -> Option<T> {
        law.map_err(|error| {
            let key = match &error {
                LawError::Gain { gain, .. } if self.has(gain) => gain,
                _ => key,
            };
            self.reject(key, error.to_string());
        })
        .ok()
    }

    /// Largest rate \[rad/s\] and acceleration \[rad/s^2\] of a law's own motion.
    pub(super) fn motion_limits(&mut self, roster: &Roster<'_>) -> (f64, f64) {
        let tightest = |of: fn(&ReferenceLimits) -> f64| {
            roster.limits.iter().map(of).fold(f64::INFINITY, f64::min).to_degrees().min(60.0)
                * STRUCTURE_SHARE
        };
        let rate_max_deg_s = self.number_or(
            "rate_max_deg_s",
            tightest(|l| l.rate_max_rad_s),
            Allowed::POSITIVE,
            "largest rate of the law's own motion; default: 0.8 of the slowest platform's limit [deg/s]",
        );
        let acceleration_max_deg_s2 = self.number_or(
            "acceleration_max_deg_s2",
            tightest(|l| l.acceleration_max_rad_s2),
            Allowed::POSITIVE,
            "largest acceleration of the law's own motion; default: 0.8 of the weakest platform's limit [deg/s^2]",
        );
        (rate_max_deg_s.to_radians(), acceleration_max_deg_s2.to_radians())
    }

    /// Damping ratio of a law's own motion.
    pub(super) fn damping(&mut self, doc: &str) -> f64 {
        self.number_or("damping", 1.0, Allowed::between(1.0, 10.0), doc)
    }

    /// Natural frequency of the platforms' own attitude loops \[rad/s\].
    pub(super) fn member_bandwidth_rad_s(&mut self) -> f64 {
        self.number_or(
            "member_bandwidth_rad_s",
            0.8,
            Allowed::POSITIVE,
            "natural frequency of the platforms' own attitude loops: 2 with wheels, 0.8 with jets [rad/s]",
        )
    }

    /// Whom a platform listens to, where that is given.
    pub(super) fn neighbours(&mut self) -> Option<Vec<usize>> {
        self.optional_platforms(
            "neighbours",
            "platforms that this one listens to; left out: all others (decentralised), those beside it in a ring \
             (behavioural)",
        )
    }
}
