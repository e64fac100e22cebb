//! Virtual structure: all platforms follow one virtual rigid body that waits for those that lag.
//!
//! # Equations
//!
//! The structure has an attitude `q_v` and a rate `omega_v`. With `e` the rotation vector from its
//! goal to it, in its own axes, and unit virtual inertia:
//!
//! ```text
//! q_v'     = 1/2 q_v (x) [0, omega_v]
//! omega_v' = sat_a( -k sat_s(e) - Gamma (omega_v - omega_goal) + omega_goal' )
//! Gamma    = d (1 + E / e_half^2),   E = mean over members of |attitude error to own reference|^2
//! k = w^2,   d = 2 z w,   s = d rate_max / k
//! ```
//!
//! and every member is asked for `q_v * q_offset` with the rate and acceleration that belong to it.
//! `Gamma` is the formation feedback `D_G + K_F E` of Ren and Beard with `D_G = d` and
//! `K_F = d / e_half^2`. During a long slew the goal term is saturated at `d rate_max`, so the
//! structure turns at `rate_max / (1 + E / e_half^2)`: half speed where the members' RMS error is
//! `e_half`, and nearly stopped where it is several times that. `e_half` infinite is the open loop.
//!
//! # Source
//! W. Ren, R. W. Beard, "Virtual structure based spacecraft formation control with formation feedback",
//! AIAA 2002-4963; the same, "Decentralized scheme for spacecraft formation flying via the virtual
//! structure approach", J. Guidance, Control, and Dynamics 27(1), 2004. The saturations are ours.
//!
//! # Stability
//! For a goal at rest and without `sat_a`, `V = U(e) + |omega_v|^2 / 2` with `U` the potential of
//! the saturated goal term (`dU/dt = k sat_s(e) . omega_v`) falls along `V' = -Gamma |omega_v|^2`, for
//! every `Gamma >= d > 0`: formation feedback only adds damping, whatever the members do. By LaSalle
//! the structure reaches its goal, except from exactly half a turn away. `sat_a` is inactive during
//! braking when `w rate_max / e <= a_max` (a critically damped stop from `rate_max` peaks there, e =
//! 2.718); [`VirtualStructure::new`] refuses gains beyond that bound. While a member is not seen the
//! structure brakes at `a_max` and stands.
//!
//! # Assumptions
//! One instance (in the coordinator) integrates the structure. Members report errors against the
//! references they were given, so a reference clipped in tilt does not count as lagging.

use nalgebra::Vector3;
use whorl_math::attitude_error;

use super::law::{limited, rigid_relation, structure_of_first};
use super::plan::PlanGains;
use super::{Allowed, MotionDemand, LawError, LawInput, Relation, RelativeAttitudeLaw, Roster, Settings};
use crate::reference::Reference;

/// Gains and limits of the structure's own motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualStructureGains {
    /// Natural frequency w \[rad/s\], > 0.
    pub bandwidth_rad_s: f64,
    /// Damping ratio z without formation feedback, >= 1.
    pub damping: f64,
    /// RMS member error at which the structure turns at half speed \[rad\], > 0; infinite: no feedback.
    pub half_speed_error_rad: f64,
    /// Largest rate \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest acceleration \[rad/s^2\], >= `bandwidth * rate_max / 2.718`.
    pub acceleration_max_rad_s2: f64,
}

impl VirtualStructureGains {
    fn plan(&self) -> PlanGains {
        let Self { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2, .. } = *self;
        PlanGains { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2 }
    }
}

/// The law.
#[derive(Debug, Clone, PartialEq)]
pub struct VirtualStructure {
    gains: VirtualStructureGains,
    structure: Option<Reference>,
}

impl VirtualStructure {
    /// A structure that starts where its members are.
    ///
    /// # Errors
    /// The first gain outside its range, with the bound.
    pub fn new(gains: VirtualStructureGains) -> Result<Self, LawError> {
        let law = Self::kind();
        gains.plan().check(law)?;
        let value = gains.half_speed_error_rad;
        if value.is_nan() || value <= 0.0 {
            let allowed = "positive".to_owned();
            return Err(LawError::Gain { law, gain: "half_speed_error_rad", value, allowed });
        }
        Ok(Self { gains, structure: None })
    }

    /// The structure's own motion; `None` before the first demand.
    #[must_use]
    pub fn structure(&self) -> Option<&Reference> {
        self.structure.as_ref()
    }

    fn acceleration_rad_s2(&self, at: &Reference, input: &LawInput<'_>) -> Vector3<f64> {
        let (g, dt_s) = (&self.gains, input.dt_s);
        let omega = at.omega_wr_r_rad_s;
        if input.members.iter().any(|m| !m.usable) {
            return if dt_s > 0.0 {
                limited(-omega / dt_s, g.acceleration_max_rad_s2)
            } else {
                Vector3::zeros()
            };
        }
        let goal = &input.goals.formation;
        let stiffness = g.bandwidth_rad_s * g.bandwidth_rad_s;
        let damping = 2.0 * g.damping * g.bandwidth_rad_s;
        let error = attitude_error(&goal.q_world_reference, &at.q_world_reference);
        let saturated = limited(error, damping * g.rate_max_rad_s / stiffness);

        // The goal's motion in the structure's axes.
        let q_structure_goal = at.q_world_reference.inverse() * goal.q_world_reference;
        let omega_goal = q_structure_goal * goal.omega_wr_r_rad_s;
        let omega_dot_goal = q_structure_goal * goal.omega_dot_wr_r_rad_s2 - omega.cross(&omega_goal);

        let gamma = damping * (1.0 + mean_square_error_rad2(input) / g.half_speed_error_rad.powi(2));
        // Implicit in the damping term: stable however large the members' errors make it.
        let rate_error = omega - omega_goal;
        let asked = (-saturated * stiffness - rate_error * gamma) / (1.0 + gamma * dt_s) + omega_dot_goal;
        limited(asked, g.acceleration_max_rad_s2)
    }

    /// The structure's motion when the first member moves as its reference does.
    fn start(input: &LawInput<'_>) -> Reference {
        structure_of_first(input)
    }
}

fn mean_square_error_rad2(input: &LawInput<'_>) -> f64 {
    let sum: f64 = input
        .members
        .iter()
        .map(|m| attitude_error(&m.reference.q_world_reference, &m.q_world_body).norm_squared())
        .sum();
    sum / input.members.len().max(1) as f64
}

impl RelativeAttitudeLaw for VirtualStructure {
    fn kind() -> &'static str {
        "virtual_structure"
    }

    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self> {
        settings.group(Self::kind(), |s| {
            let PlanGains { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2 } =
                PlanGains::read(s, roster, "structure", "damping ratio without feedback [1]");
            let gains = VirtualStructureGains {
                bandwidth_rad_s,
                damping,
                half_speed_error_rad: s
                    .number_or(
                        "half_speed_error_deg",
                        1.0,
                        Allowed::at_least_or_infinite(0.01),
                        "formation feedback: RMS error of the members at which the structure turns at half \
                         speed; .inf: open loop [deg]",
                    )
                    .to_radians(),
                rate_max_rad_s,
                acceleration_max_rad_s2,
            };
            s.accept(Self::new(gains), "bandwidth_rad_s")
        })
    }

    fn moves_a_structure(&self) -> bool {
        true
    }

    fn plans_its_way(&self) -> bool {
        true
    }

    /// It waits for members that lag; without formation feedback it goes on alone.
    fn needs_all(&self) -> bool {
        self.gains.half_speed_error_rad.is_finite()
    }

    fn restart(&mut self, input: &LawInput<'_>) {
        self.structure = Some(Self::start(input));
    }

    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>) {
        let mut structure =
            self.structure.map_or_else(|| Self::start(input), |last| last.extrapolated(input.dt_s));
        structure.omega_dot_wr_r_rad_s2 = self.acceleration_rad_s2(&structure, input);
        self.structure = Some(structure);
        demands.clear();
        demands.extend(input.members.iter().enumerate().map(|(platform, member)| {
            match input.offsets.get(platform) {
                Some(offset) if member.usable => MotionDemand::Follow(offset.apply(&structure)),
                _ => MotionDemand::Hold,
            }
        }));
    }

    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation> {
        rigid_relation(input, platform)
    }
}
