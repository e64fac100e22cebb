//! Whether the best set of names explains the data to the noise, or something is missing that has no name.
//!
//! A name must explain what is there in every part of the data. What its set leaves is compared with torques and
//! readings of simple shape, and with a torque that is free in time; a name that such a law outdoes, although the
//! law pays for its freedom, or of which another law is left, is not the answer.

use whorl_dynamics::effects::{Rhythm, find};

use crate::search::{LEAST_DROP, LEAST_EVIDENCE, Search};
use crate::unknown::{Follower, describe};

/// An unexplained rest of this many standard deviations is real.
pub(crate) const REAL_REST: f64 = 8.0;

/// From here on a rest is compared with torques of simple shape.
const WORTH_A_LOOK: f64 = 3.5;

/// A rest beyond this is real whether or not it has a simple shape.
const OVERWHELMING_REST: f64 = 40.0;

/// Slow power over that of noise that is left even when every effect of the catalogue may help.
const INEXPLICABLE: f64 = 2.5;

/// An effect that explains this share of the excess is not refuted by what its formula, never quite that of the
/// real platform, leaves.
const NEARLY_ALL: f64 = 0.97;

/// Where a rest is real, names must explain this share of the excess: a real law that differs by a third from its
/// formula leaves a tenth, and none differs so much.
const LEAST_OF_REST: f64 = 0.9;

/// Log evidence by which a torque without a name must outdo the named set: a name of the catalogue is the likelier
/// of the two before any data, some thousand to one.
const OUTDONE: f64 = 10.0;

/// Of what names explain, this share of the misfit's drop is owed to their formulas: no real friction, plenum or
/// fan follows its law to better than a tenth of its size, which leaves (10 %)^2, in log evidence half of that.
const OWN_FORMULA: f64 = 0.005;

/// What is left of an effect is another law's where it is a fifth of the effect's size, (20 %)^2 of the drop: twice
/// what its own formula may leave.
const OTHER_LAW: f64 = 0.04;

/// A named set must explain at least this share of what the base model leaves.
const LEAST_SHARE: f64 = 0.6;

/// What is to be thought of the best set.
pub(crate) struct Adequacy {
    /// The law without a name that explains most, where one was looked for.
    pub follower: Option<Follower>,
    /// Something without a name is missing.
    pub unexplained: bool,
}

impl Search<'_> {
    /// Judges the best set by the significance of the rest that it leaves and its share of the slow excess.
    pub(crate) fn adequacy(&self, names: &[String], left: f64, share: f64) -> Adequacy {
        let (explained, explained_drop) = self.advantage(&self.best, &self.base);
        // A line may be that of a torque of another kind, although no slow rest is left: pumps turn with the body, and
        // a boom that is hardly damped rings like one.
        let rhythms: Vec<Rhythm> = names.iter().filter_map(|n| find(n)?.rhythm()).collect();
        let (rings, rhythmic) = (rhythms.contains(&Rhythm::Ringing), !rhythms.is_empty());
        let follower = if left > WORTH_A_LOOK || rhythmic {
            describe(self, false)
        } else if self.best.members.is_empty() {
            // Errors of sensors may come and go too fast to leave a slow rest.
            describe(self, true)
        } else {
            None
        };
        let unexplained = follower.as_ref().is_some_and(|f| {
            // What has no name explains the data better than all names together, in the regression in which it was
            // tried and where each set fits best: of a large effect these may differ much.
            // A resonance's frequency and damping enter the regression as if they could go anywhere: there it may ring
            // for ever, and only where it was fitted it is a resonance.
            let in_regression = self.best.log_evidence - self.base.log_evidence;
            let by_names = if rings { explained } else { explained.max(in_regression) };
            let replaces =
                f.alone_evidence > by_names + OUTDONE * self.data.temper + OWN_FORMULA * explained_drop;
            // A shape without a name must add what an effect must add, and outweigh what names explain.
            let real = f.added_evidence > 1.6 * LEAST_EVIDENCE * self.data.temper
                && f.added_drop > 1.4 * LEAST_DROP * self.data.temper;
            let outweighs = self.best.members.is_empty() || f.added_drop > OTHER_LAW * explained_drop;
            (replaces && !self.best.members.is_empty()) || (real && outweighs)
        }) || (left > OVERWHELMING_REST && share < LEAST_SHARE)
            || (left > REAL_REST && share < LEAST_OF_REST && !self.best.members.is_empty())
            || (self.data.temper > INEXPLICABLE && share < NEARLY_ALL);
        Adequacy { follower, unexplained }
    }
}
