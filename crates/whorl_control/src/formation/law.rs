//! The interface of all relative-attitude laws.

use std::any::Any;

use nalgebra::{UnitQuaternion, Vector3};
use whorl_math::attitude_error;

use super::{Roster, Settings};
use crate::reference::Reference;

/// The state of one platform at one instant, as laws see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member {
    /// Estimated attitude, extrapolated to the instant; meaningless unless `usable`.
    pub q_world_body: UnitQuaternion<f64>,
    /// Estimated rate, body axes \[rad/s\]; meaningless unless `usable`.
    pub omega_wb_b_rad_s: Vector3<f64>,
    /// Age of the estimate \[s\]; infinite when there never was one.
    pub age_s: f64,
    /// Whether the estimate is fresh and healthy.
    pub usable: bool,
    /// Whether the platform's controller follows its reference.
    pub tracking: bool,
    /// The reference that the platform follows at this instant.
    pub reference: Reference,
}

/// Commanded attitude of a platform relative to its leader or to the virtual structure:
/// `q_world_platform = q_world_leader * q_leader_platform`. It may move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    /// Rotates the platform's axes into the leader's.
    pub q_leader_platform: UnitQuaternion<f64>,
    /// Rate of the platform seen from the leader, in the platform's axes \[rad/s\].
    pub omega_lp_p_rad_s: Vector3<f64>,
    /// Time derivative of that rate in the platform's axes \[rad/s^2\].
    pub omega_dot_lp_p_rad_s2: Vector3<f64>,
}

impl Offset {
    /// An offset that does not move.
    #[must_use]
    pub fn constant(q_leader_platform: UnitQuaternion<f64>) -> Self {
        Self {
            q_leader_platform,
            omega_lp_p_rad_s: Vector3::zeros(),
            omega_dot_lp_p_rad_s2: Vector3::zeros(),
        }
    }

    /// An offset that moves: the motion of the platform's frame seen from the leader's.
    #[must_use]
    pub fn moving(leader_platform: &Reference) -> Self {
        Self {
            q_leader_platform: leader_platform.q_world_reference,
            omega_lp_p_rad_s: leader_platform.omega_wr_r_rad_s,
            omega_dot_lp_p_rad_s2: leader_platform.omega_dot_wr_r_rad_s2,
        }
    }

    /// The offset at which a platform that moves so stands to a leader that moves so.
    #[must_use]
    pub fn between(leader: &Reference, platform: &Reference) -> Self {
        let q = leader.q_world_reference.inverse() * platform.q_world_reference;
        let carried = q.inverse() * leader.omega_wr_r_rad_s;
        let omega_lp_p_rad_s = platform.omega_wr_r_rad_s - carried;
        Self {
            q_leader_platform: q,
            omega_lp_p_rad_s,
            omega_dot_lp_p_rad_s2: platform.omega_dot_wr_r_rad_s2
                - q.inverse() * leader.omega_dot_wr_r_rad_s2
                + omega_lp_p_rad_s.cross(&carried),
        }
    }

    /// The leader seen from the platform: `self.inverse().apply(&self.apply(x)) == x`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let q = &self.q_leader_platform;
        Self {
            q_leader_platform: q.inverse(),
            omega_lp_p_rad_s: -(q * self.omega_lp_p_rad_s),
            // The axes turn with omega_lp, whose cross product with itself vanishes.
            omega_dot_lp_p_rad_s2: -(q * self.omega_dot_lp_p_rad_s2),
        }
    }

    /// The motion of a platform that keeps this offset exactly to a leader that moves so.
    ///
    /// With `w = R^T omega_leader`: `omega = w + omega_lp` and
    /// `omega' = R^T omega_leader' + omega_lp' - omega_lp x w` (transport theorem).
    #[must_use]
    pub fn apply(&self, leader: &Reference) -> Reference {
        let carried = leader.with_offset(&self.q_leader_platform);
        Reference {
            q_world_reference: carried.q_world_reference,
            omega_wr_r_rad_s: carried.omega_wr_r_rad_s + self.omega_lp_p_rad_s,
            omega_dot_wr_r_rad_s2: carried.omega_dot_wr_r_rad_s2 + self.omega_dot_lp_p_rad_s2
                - self.omega_lp_p_rad_s.cross(&carried.omega_wr_r_rad_s),
        }
    }
}

/// Where the experiment wants the formation.
#[derive(Debug, Clone, PartialEq)]
pub struct Goals {
    /// Motion asked of the formation: of its leaders, or of the virtual structure.
    pub formation: Reference,
    /// A motion of its own for a platform, in place of the formation's. Empty when there is none.
    pub individual: Vec<Option<Reference>>,
}

impl Goals {
    /// The motion asked of a platform that leads.
    #[must_use]
    pub fn of(&self, platform: usize) -> &Reference {
        self.individual.get(platform).and_then(Option::as_ref).unwrap_or(&self.formation)
    }
}

/// Everything a law sees at one instant. All slices are in the order of platforms.
#[derive(Debug, Clone, Copy)]
pub struct LawInput<'a> {
    /// Time since the previous call \[s\].
    pub dt_s: f64,
    /// The platforms.
    pub members: &'a [Member],
    /// Where to.
    pub goals: &'a Goals,
    /// Commanded offset of each platform; unused for one that leads.
    pub offsets: &'a [Offset],
}

/// The demand of a law for one platform. Unshaped: it may jump and ignore limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotionDemand {
    /// Move so.
    Follow(Reference),
    /// The platforms that it depends on are unknown: come to rest and stay.
    Hold,
}

/// Commanded attitude of a platform relative to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// The platform that it is relative to; `None`: the world.
    pub leader: Option<usize>,
    /// `q_world_platform = q_world_leader * q_leader_platform`; without a leader, the reference itself.
    pub q_leader_platform: UnitQuaternion<f64>,
}

/// The relation of a formation whose members all have a place on one virtual body: seen from the first
/// platform, and for that one against its own reference.
pub(super) fn rigid_relation(input: &LawInput<'_>, platform: usize) -> Option<Relation> {
    let own = input.offsets.get(platform)?.q_leader_platform;
    if platform == 0 {
        let q_leader_platform = input.members.first()?.reference.q_world_reference;
        return Some(Relation { leader: None, q_leader_platform });
    }
    let first = input.offsets.first()?.q_leader_platform;
    Some(Relation { leader: Some(0), q_leader_platform: first.inverse() * own })
}

/// Motion of the virtual body when the first member moves on it as its reference does; it begins without
/// acceleration.
pub(super) fn structure_of_first(input: &LawInput<'_>) -> Reference {
    let unknown = || Reference::at_rest(UnitQuaternion::identity());
    let first = input.members.first().map_or_else(unknown, |m| m.reference);
    let moved = input.offsets.first().map_or(first, |offset| offset.inverse().apply(&first));
    Reference { omega_dot_wr_r_rad_s2: Vector3::zeros(), ..moved }
}

/// Motion of a member: its estimated attitude; rate and acceleration of its own reference while it
/// tracks that (known without noise and in advance), else the estimated rate.
pub(super) fn member_motion(member: &Member) -> Reference {
    let (omega_wr_r_rad_s, omega_dot_wr_r_rad_s2) = if member.tracking {
        (member.reference.omega_wr_r_rad_s, member.reference.omega_dot_wr_r_rad_s2)
    } else {
        (member.omega_wb_b_rad_s, Vector3::zeros())
    };
    Reference { q_world_reference: member.q_world_body, omega_wr_r_rad_s, omega_dot_wr_r_rad_s2 }
}

pub(super) fn limited(vector: Vector3<f64>, max_norm: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > max_norm { vector * (max_norm / norm) } else { vector }
}

/// A relative-attitude law.
///
/// Deterministic and without limits of its own on what the platforms can do; see the module's doc for
/// who shapes the demands. An instance that has demanded nothing yet serves as the pattern of further ones ([`Clone`]).
pub trait RelativeAttitudeLaw: TypedLaw + std::fmt::Debug + Send + Sync {
    /// Its name in parameter files, messages and reports; also of the group of its settings.
    fn kind() -> &'static str
    where
        Self: Sized;

    /// Reads its settings, and those of each member; `None` after refusing them.
    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self>
    where
        Self: Sized;

    /// Whether the experiment's steps move one frame of the whole formation, and not its leaders.
    fn moves_a_structure(&self) -> bool;

    /// Whether it plans its own motion to a goal that jumps; else goals move smoothly within the limits.
    fn plans_its_way(&self) -> bool;

    /// Whether the formation cannot go on without one of its members.
    fn needs_all(&self) -> bool;

    /// The platform's leader, if it follows one.
    fn leader(&self, _platform: usize) -> Option<usize> {
        None
    }

    /// Whether the platform takes its motion from the experiment's steps.
    fn leads(&self, platform: usize) -> bool {
        !self.moves_a_structure() && self.leader(platform).is_none()
    }

    /// Whether each platform may run the law for itself, from what it [`hears`](Self::hears).
    fn runs_on_platforms() -> bool
    where
        Self: Sized,
    {
        false
    }

    /// Whether a platform's demand depends on the state of the other one.
    fn hears(&self, _platform: usize, _other: usize) -> bool {
        true
    }

    /// Forgets the past and starts from the references that the platforms follow now, with their rates.
    fn restart(&mut self, input: &LawInput<'_>);

    /// Replaces `demands` with one demand per platform.
    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>);

    /// What the law asks of a platform relative to another one, or to the world. `None` for a
    /// platform that does not exist.
    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation>;

    /// Broadcasts of platforms to their neighbours so far, for a law that decides when they speak.
    fn broadcasts(&self) -> Option<u64> {
        None
    }

    /// The rotation vector \[rad\], in body axes, of the platform's estimated attitude against its
    /// [`Relation`]. `None` while either attitude is unknown.
    fn relative_error_rad(&self, input: &LawInput<'_>, platform: usize) -> Option<Vector3<f64>> {
        let relation = self.relation(input, platform)?;
        let usable = |index: usize| input.members.get(index).filter(|m| m.usable);
        let asked = match relation.leader {
            None => relation.q_leader_platform,
            Some(leader) => usable(leader)?.q_world_body * relation.q_leader_platform,
        };
        Some(attitude_error(&asked, &usable(platform)?.q_world_body))
    }
}

/// What follows from the type of a law, for one that is only known as a [`RelativeAttitudeLaw`]: every type gets it.
pub trait TypedLaw {
    /// [`RelativeAttitudeLaw::kind`].
    fn name(&self) -> &'static str;
    /// A copy.
    fn boxed(&self) -> Box<dyn RelativeAttitudeLaw>;
    /// Whether the other one is the same law in the same state.
    fn equals(&self, other: &dyn RelativeAttitudeLaw) -> bool;
    /// For [`Self::equals`].
    fn as_any(&self) -> &dyn Any;
}

impl<L: RelativeAttitudeLaw + Clone + PartialEq + 'static> TypedLaw for L {
    fn name(&self) -> &'static str {
        L::kind()
    }

    fn boxed(&self) -> Box<dyn RelativeAttitudeLaw> {
        Box::new(self.clone())
    }

    fn equals(&self, other: &dyn RelativeAttitudeLaw) -> bool {
        other.as_any().downcast_ref::<L>() == Some(self)
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

impl Clone for Box<dyn RelativeAttitudeLaw> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

impl PartialEq for dyn RelativeAttitudeLaw {
    fn eq(&self, other: &Self) -> bool {
        self.equals(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whorl_math::quaternion_exp;

    #[test]
    fn an_offset_undone_gives_the_leader_back() {
        let leader = Reference {
            q_world_reference: quaternion_exp(&Vector3::new(0.3, -0.2, 0.9)),
            omega_wr_r_rad_s: Vector3::new(0.1, 0.2, -0.3),
            omega_dot_wr_r_rad_s2: Vector3::new(-0.05, 0.02, 0.04),
        };
        let offset = Offset {
            q_leader_platform: quaternion_exp(&Vector3::new(-0.4, 0.5, 0.1)),
            omega_lp_p_rad_s: Vector3::new(0.2, -0.1, 0.15),
            omega_dot_lp_p_rad_s2: Vector3::new(0.03, 0.07, -0.02),
        };
        let again = Offset::between(&leader, &offset.apply(&leader));
        assert!((again.omega_lp_p_rad_s - offset.omega_lp_p_rad_s).norm() < 1e-14);
        assert!((again.omega_dot_lp_p_rad_s2 - offset.omega_dot_lp_p_rad_s2).norm() < 1e-14);
        let back = offset.inverse().apply(&offset.apply(&leader));
        assert!(attitude_error(&leader.q_world_reference, &back.q_world_reference).norm() < 1e-14);
        assert!((back.omega_wr_r_rad_s - leader.omega_wr_r_rad_s).norm() < 1e-14);
        assert!((back.omega_dot_wr_r_rad_s2 - leader.omega_dot_wr_r_rad_s2).norm() < 1e-14);
    }

    #[test]
    fn a_moving_offset_on_a_moving_leader_gives_the_derivatives() {
        let leader = Reference {
            q_world_reference: quaternion_exp(&Vector3::new(0.3, -0.2, 1.0)),
            omega_wr_r_rad_s: Vector3::new(0.1, 0.2, -0.3),
            omega_dot_wr_r_rad_s2: Vector3::new(-0.2, 0.05, 0.1),
        };
        let offset = Offset {
            q_leader_platform: quaternion_exp(&Vector3::new(-0.5, 0.4, 0.2)),
            omega_lp_p_rad_s: Vector3::new(0.3, -0.1, 0.15),
            omega_dot_lp_p_rad_s2: Vector3::new(0.07, 0.2, -0.1),
        };
        let at = |t: f64| {
            let own = Reference {
                q_world_reference: offset.q_leader_platform,
                omega_wr_r_rad_s: offset.omega_lp_p_rad_s,
                omega_dot_wr_r_rad_s2: offset.omega_dot_lp_p_rad_s2,
            }
            .extrapolated(t);
            let moved = Offset {
                q_leader_platform: own.q_world_reference,
                omega_lp_p_rad_s: own.omega_wr_r_rad_s,
                ..offset
            };
            moved.apply(&leader.extrapolated(t))
        };
        let h = 1e-4;
        let (before, now, after) = (at(-h), at(0.0), at(h));
        let rate = attitude_error(&before.q_world_reference, &after.q_world_reference) / (2.0 * h);
        assert!((rate - now.omega_wr_r_rad_s).norm() < 1e-7);
        let acceleration = (after.omega_wr_r_rad_s - before.omega_wr_r_rad_s) / (2.0 * h);
        assert!((acceleration - now.omega_dot_wr_r_rad_s2).norm() < 1e-7);
    }
}
