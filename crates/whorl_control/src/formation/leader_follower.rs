//! Leader-follower: each follower takes its leader's estimated attitude times a commanded offset.
//!
//! # Equations
//!
//! With follower F, leader L and offset `q_lf` (which may move, see [`Offset::apply`]):
//!
//! ```text
//! q_demand      = q_leader_estimated * q_lf
//! omega_demand  = R(q_lf)^T omega_leader + omega_lf
//! omega'_demand = R(q_lf)^T omega'_leader + omega'_lf - omega_lf x R(q_lf)^T omega_leader
//! ```
//!
//! The attitude is the leader's estimate, so an error that the leader's controller makes is followed.
//! Rate and acceleration are those of the leader's own reference while it tracks it: they are known
//! without noise and in advance, so a follower does not lag behind a leader that moves. When the
//! leader does not track, its estimated rate takes their place, with no acceleration.
//!
//! # Source
//! Schwartz 2004, section 2.4 (leader-follower, chains, trees, parallel leaders); P. K. C. Wang,
//! F. Y. Hadaegh, "Coordination and control of multiple microspacecraft moving in formation", J.
//! Astronautical Sciences 44(3), 1996.
//!
//! # Stability
//! The demand passes a [`crate::formation::ReferenceShaper`], inside its limits the linear critically
//! damped filter `e'' + 2 w e' + w^2 e = 0` of the difference `e` between demand and reference, and
//! then the follower's attitude loop. Nothing flows from follower to leader, so a formation is a
//! cascade: exponential stability of every platform's own loop gives exponential convergence of every
//! relative error to zero, for any forest and any constant delay of the leader's estimate. Along a
//! chain the low-frequency error of the head reaches every member (gain one) and the filters add
//! peaking at their own bandwidth; keep chains short or their bandwidths falling.
//!
//! # Assumptions
//! One clock; estimates extrapolated to the instant of the demand; the leader can do what its
//! reference asks.

use super::law::member_motion;
use super::{MotionDemand, LawInput, LeaderGraph, Relation, RelativeAttitudeLaw, Roster, Settings};

/// The law. It has no memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LeaderFollower {
    graph: LeaderGraph,
}

impl LeaderFollower {
    /// A law over this graph.
    #[must_use]
    pub fn new(graph: LeaderGraph) -> Self {
        Self { graph }
    }

    fn demand(&self, input: &LawInput<'_>, platform: usize) -> MotionDemand {
        match self.graph.leader(platform) {
            None => match input.members.get(platform) {
                // A leader that is not seen waits for its link: it must not be led further blindly.
                Some(member) if !member.usable => MotionDemand::Hold,
                _ => MotionDemand::Follow(*input.goals.of(platform)),
            },
            Some(leader) => match (input.members.get(leader), input.offsets.get(platform)) {
                (Some(leader), Some(offset)) if leader.usable => {
                    MotionDemand::Follow(offset.apply(&member_motion(leader)))
                }
                _ => MotionDemand::Hold,
            },
        }
    }
}

impl RelativeAttitudeLaw for LeaderFollower {
    fn kind() -> &'static str {
        "leader_follower"
    }

    /// The first platform leads and all others follow it, unless their settings say otherwise.
    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self> {
        let leaders = settings.members(roster, |s, platform| {
            let default = (platform != 0).then_some(0);
            s.platform_or("leader", default, "the platform that this one follows; empty: it leads itself")
        });
        LeaderGraph::new(leaders).map_err(|e| settings.reject("members", e.to_string())).ok().map(Self::new)
    }

    fn moves_a_structure(&self) -> bool {
        false
    }

    fn plans_its_way(&self) -> bool {
        false
    }

    fn needs_all(&self) -> bool {
        false
    }

    fn leader(&self, platform: usize) -> Option<usize> {
        self.graph.leader(platform)
    }

    fn restart(&mut self, _input: &LawInput<'_>) {}

    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>) {
        demands.clear();
        demands.extend((0..input.members.len()).map(|platform| self.demand(input, platform)));
    }

    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation> {
        let leader = self.graph.leader(platform);
        let q_leader_platform = match leader {
            None => input.members.get(platform)?.reference.q_world_reference,
            Some(_) => input.offsets.get(platform)?.q_leader_platform,
        };
        Some(Relation { leader, q_leader_platform })
    }
}
