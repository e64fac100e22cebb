//! Behavioural: each platform's motion is the weighted sum of several behaviours.
//!
//! # Equations
//!
//! Each platform has a commanded motion `(q, omega)` with unit inertia. With `e` the rotation vector from its
//! goal to it, `e_j` that from its place relative to neighbour j, in own axes:
//!
//! ```text
//! omega' = sat_a( - k_g sat_s(e)                  goal-seeking        k_g = w_g^2
//!                 - sum_j k_f e_j                  formation-keeping   k_f = w_f^2
//!                 - d omega - sum_j d_f (omega - omega_j) )            d = 2 z w_g, d_f = 2 z w_f
//!          + avoidance of the keep-out direction (see keep_out.rs),    s = d rate_max / k_g
//! ```
//!
//! the rates relative to a goal that moves. Neighbours are seen as they are: `e_j` comes from their estimated
//! attitudes, so a platform waits for a neighbour that lags.
//!
//! # Source
//! T. Balch, R. C. Arkin, "Behavior-based formation control for multirobot teams", IEEE Trans. Robotics and
//! Automation 14(6), 1998; J. R. Lawton, R. W. Beard, "Synchronized multiple spacecraft rotations", Automatica
//! 38(8), 2002. Schwartz 2004, section 2.4. The saturations are ours.
//!
//! # Stability
//! For mutual neighbours, a goal at rest and ideal platforms,
//! `V = sum_i [ U(e_i) + A_i + |omega_i|^2/2 ] + sum_edges k_f |e_ij|^2/2` (U, A the potentials of the saturated
//! goal term and of the avoidance) falls along `V' = -sum d |omega_i|^2 - sum_edges d_f |omega_i - omega_j|^2`.
//! By LaSalle all come to rest where the behaviours balance; without a keep-out direction in the way that is
//! the goal alone. [`Behavioural::new`] refuses neighbours that are not mutual, a goal bandwidth that could
//! not brake in time (`w_g rate_max / 2.718 > a_max`), formation-keeping faster than half the platforms' own
//! loops, and a keep-out influence below `rate_max^2 / a_max` (the guarantee in `keep_out.rs`).
//!
//! # Assumptions
//! One clock; relative errors below a half turn; platforms that can do what the limits say.

use nalgebra::Vector3;
use whorl_math::attitude_error;

use super::keep_out::KeepOut;
use super::law::{limited, member_motion, rigid_relation};
use super::{
    Allowed, MotionDemand, LawError, LawInput, Offset, Relation, RelativeAttitudeLaw, Roster, Settings,
};
use crate::reference::Reference;

/// Weights and limits.
#[derive(Debug, Clone, PartialEq)]
pub struct BehaviouralSettings {
    /// Goal-seeking: natural frequency `w_g` \[rad/s\], > 0.
    pub goal_bandwidth_rad_s: f64,
    /// Formation-keeping towards each neighbour: natural frequency `w_f` \[rad/s\], >= 0.
    pub keeping_bandwidth_rad_s: f64,
    /// Damping ratio `z`, >= 1.
    pub damping: f64,
    /// Largest rate of the goal-seeking \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest acceleration \[rad/s^2\], > 0.
    pub acceleration_max_rad_s2: f64,
    /// Natural frequency of the platforms' own attitude loops \[rad/s\], > 0.
    pub member_bandwidth_rad_s: f64,
    /// Whom each platform keeps formation with; mutual.
    pub neighbours: Vec<Vec<usize>>,
    /// What each platform's boresight must stay away from.
    pub keep_out: Vec<Option<KeepOut>>,
}

/// The law.
#[derive(Debug, Clone, PartialEq)]
pub struct Behavioural {
    settings: BehaviouralSettings,
    commanded: Vec<Option<Reference>>,
}

impl Behavioural {
    /// A law with these weights.
    ///
    /// # Errors
    /// The first setting outside its proven range, with the bound.
    pub fn new(settings: BehaviouralSettings) -> Result<Self, LawError> {
        settings.check()?;
        let commanded = vec![None; settings.neighbours.len()];
        Ok(Self { settings, commanded })
    }

    /// What the platform stays away from.
    #[must_use]
    pub fn keep_out(&self, platform: usize) -> Option<&KeepOut> {
        self.settings.keep_out.get(platform)?.as_ref()
    }

    fn acceleration_rad_s2(&self, at: &Reference, input: &LawInput<'_>, platform: usize) -> Vector3<f64> {
        let s = &self.settings;
        let Some(offset) = input.offsets.get(platform) else { return Vector3::zeros() };
        let (k_goal, d_goal) = (s.goal_bandwidth_rad_s.powi(2), 2.0 * s.damping * s.goal_bandwidth_rad_s);
        let (k_keep, d_keep) =
            (s.keeping_bandwidth_rad_s.powi(2), 2.0 * s.damping * s.keeping_bandwidth_rad_s);
        let omega = at.omega_wr_r_rad_s;
        let error = |other: &Reference| attitude_error(&other.q_world_reference, &at.q_world_reference);
        let rate = |other: &Reference| {
            at.q_world_reference.inverse() * other.q_world_reference * other.omega_wr_r_rad_s
        };

        let goal = offset.apply(&input.goals.formation);
        let pull_max = d_goal * s.rate_max_rad_s / k_goal;
        let mut asked = -limited(error(&goal), pull_max) * k_goal + rate(&goal) * d_goal;
        let mut damping = d_goal;
        for neighbour in s.neighbours.get(platform).into_iter().flatten() {
            let Some(member) = input.members.get(*neighbour).filter(|m| m.usable) else { continue };
            let Some(place) = input.offsets.get(*neighbour).map(Offset::inverse) else { continue };
            let wanted = offset.apply(&place.apply(&member_motion(member)));
            asked += -error(&wanted) * k_keep + rate(&wanted) * d_keep;
            damping += d_keep;
        }
        // Implicit in the damping: stable whatever the number of neighbours.
        let weighted = (asked - omega * damping) / (1.0 + damping * input.dt_s);
        let Some(keep_out) = self.keep_out(platform) else {
            return limited(weighted, s.acceleration_max_rad_s2);
        };
        let approach = keep_out.approach(&at.q_world_reference);
        let pulled = limited(weighted + keep_out.pull_rad_s2(&approach), s.acceleration_max_rad_s2);
        keep_out.braked_rad_s2(&approach, &omega, pulled, s.acceleration_max_rad_s2)
    }
}

impl BehaviouralSettings {
    fn check(&self) -> Result<(), LawError> {
        let refuse =
            |gain, value, allowed: String| LawError::Gain { law: "behavioural", gain, value, allowed };
        for (gain, value) in [
            ("goal_bandwidth_rad_s", self.goal_bandwidth_rad_s),
            ("rate_max_rad_s", self.rate_max_rad_s),
            ("acceleration_max_rad_s2", self.acceleration_max_rad_s2),
            ("member_bandwidth_rad_s", self.member_bandwidth_rad_s),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(refuse(gain, value, "positive and finite".into()));
            }
        }
        if !(self.damping >= 1.0 && self.damping.is_finite()) {
            return Err(refuse("damping", self.damping, "at least 1: less overshoots".into()));
        }
        let fastest = std::f64::consts::E * self.acceleration_max_rad_s2 / self.rate_max_rad_s;
        if self.goal_bandwidth_rad_s > fastest {
            return Err(refuse(
                "goal_bandwidth_rad_s",
                self.goal_bandwidth_rad_s,
                format!(
                    "at most {fastest:.3}, 2.718 acceleration_max / rate_max: it could not brake in time"
                ),
            ));
        }
        let half = 0.5 * self.member_bandwidth_rad_s;
        if !(0.0..=half).contains(&self.keeping_bandwidth_rad_s) {
            return Err(refuse(
                "keeping_bandwidth_rad_s",
                self.keeping_bandwidth_rad_s,
                format!("0 to {half:.3}, half the platforms' own bandwidth"),
            ));
        }
        let least = self.rate_max_rad_s.powi(2) / self.acceleration_max_rad_s2;
        for keep_out in self.keep_out.iter().flatten() {
            if keep_out.influence_rad.is_nan() || keep_out.influence_rad < least {
                return Err(refuse(
                    "keep_out influence_rad",
                    keep_out.influence_rad,
                    format!(
                        "at least {least:.4}, rate_max^2 / acceleration_max: it could not stop in front of the cone"
                    ),
                ));
            }
        }
        for (platform, own) in self.neighbours.iter().enumerate() {
            let one_sided =
                |j: &&usize| self.neighbours.get(**j).is_none_or(|theirs| !theirs.contains(&platform));
            if let Some(neighbour) = own.iter().find(one_sided) {
                return Err(LawError::NotMutual { law: "behavioural", platform, neighbour: *neighbour });
            }
        }
        Ok(())
    }
}

impl RelativeAttitudeLaw for Behavioural {
    fn kind() -> &'static str {
        "behavioural"
    }

    /// A platform keeps formation with those beside it in a ring, unless its settings say otherwise.
    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self> {
        let members = settings.members(roster, |s, platform| {
            let neighbours = s.neighbours().unwrap_or_else(|| roster.beside(platform));
            let keep_out = s.has("keep_out").then(|| s.group("keep_out", KeepOut::read));
            (neighbours, keep_out)
        });
        let (neighbours, keep_out) = members.into_iter().unzip();
        settings.group(Self::kind(), |s| {
            let (rate_max_rad_s, acceleration_max_rad_s2) = s.motion_limits(roster);
            let settings = BehaviouralSettings {
                goal_bandwidth_rad_s: s.number_or(
                    "goal_bandwidth_rad_s",
                    0.3,
                    Allowed::POSITIVE,
                    "weight of goal-seeking; at most 2.718 acceleration / rate [rad/s]",
                ),
                keeping_bandwidth_rad_s: s.number_or(
                    "keeping_bandwidth_rad_s",
                    0.3,
                    Allowed::NON_NEGATIVE,
                    "weight of formation-keeping towards each neighbour; at most half the platforms' bandwidth [rad/s]",
                ),
                damping: s.damping("damping ratio [1]"),
                rate_max_rad_s,
                acceleration_max_rad_s2,
                member_bandwidth_rad_s: s.member_bandwidth_rad_s(),
                neighbours,
                keep_out,
            };
            s.accept(Self::new(settings), "goal_bandwidth_rad_s")
        })
    }

    fn moves_a_structure(&self) -> bool {
        true
    }

    fn plans_its_way(&self) -> bool {
        true
    }

    fn needs_all(&self) -> bool {
        false
    }

    fn restart(&mut self, input: &LawInput<'_>) {
        self.commanded = input.members.iter().map(|m| Some(m.reference)).collect();
    }

    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>) {
        self.commanded.resize(input.members.len(), None);
        demands.clear();
        for (platform, member) in input.members.iter().enumerate() {
            if !member.usable {
                // It starts again from where its reference came to rest.
                self.commanded[platform] = None;
                demands.push(MotionDemand::Hold);
                continue;
            }
            let mut at = self.commanded[platform]
                .map_or_else(|| member.reference, |last| last.extrapolated(input.dt_s));
            at.omega_dot_wr_r_rad_s2 = self.acceleration_rad_s2(&at, input, platform);
            self.commanded[platform] = Some(at);
            demands.push(MotionDemand::Follow(at));
        }
    }

    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation> {
        rigid_relation(input, platform)
    }
}
