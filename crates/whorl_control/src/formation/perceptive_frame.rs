//! Perceptive frame: the formation's frame moves along its path by what the sensors see of the members, not
//! by the clock.
//!
//! # Equations
//!
//! The frame has an attitude `q_f` and a planned rate `omega_f`; `e` is the rotation vector from the goal to it,
//! `u = -e/|e|` the direction of its path. Members that are seen and tracking, each at its offset, imply
//! where the frame really is; `p` is the mean of these rotation vectors from `q_f`, and its component along the path is
//! the perceived progress:
//!
//! ```text
//! omega_f' = sat_a( -k sat_s(e) - d (omega_f - omega_goal) + omega_goal' )     k = w^2, d = 2 z w, s = d rate_max / k
//! c'       = f ( (p . u) |e| / (|e| + e_0) - c )                               f = 1/s, e_0 = 0.5 deg
//! q_f'     = 1/2 q_f (x) [0, omega_f + l c u]
//! ```
//!
//! A formation that is held back holds its frame back, and the plan does not run away from it; pushed
//! ahead, it takes the frame along. Across the path nothing is perceived: there the frame stays what the
//! members are led back to. A member that fails is no longer perceived, and the rest go on. `l = 0` is a
//! virtual structure in open loop.
//!
//! # Source
//! W. Kang, N. Xi, A. Sparks, "Formation control of autonomous agents in 3D workspace", IEEE ICRA 2000; W.
//! Kang, A. Sparks, S. Banda, "Coordinated control of multisatellite systems", J. Guidance, Control, and
//! Dynamics 24(2), 2001 (action reference projected from sensed states). Schwartz 2004, section 2.4.
//!
//! # Stability
//! Members follow the frame along its path by a loop T with a bandwidth w_m and feed-forward:
//! `1 - T = s^2/(s + w_m)^2`. The perceived progress closes a loop around it with gain
//! `l |1 - T|/|s| = l w/(w^2 + w_m^2) <= l / (2 w_m)`, the filter of c only lowers it: for `l < 2 w_m` the
//! small-gain theorem gives stability, and [`PerceptiveFrame::new`] refuses more. The plan itself is the
//! damped, saturated motion of `virtual_structure.rs` without feedback and converges as shown there.
//!
//! # Assumptions
//! One instance owns the frame; one clock; deviations below a half turn.

use nalgebra::Vector3;
use whorl_math::{attitude_error, quaternion_exp};

use super::law::{limited, rigid_relation, structure_of_first};
use super::plan::{PlanGains, require_positive};
use super::{Allowed, MotionDemand, LawError, LawInput, Relation, RelativeAttitudeLaw, Roster, Settings};
use crate::reference::Reference;

/// Pole of the filter of the perceived progress \[1/s\].
const PROGRESS_POLE_S: f64 = 1.0;
/// Nearer to the goal than this the path has no clear direction \[rad\].
const NEAR_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Gains and limits of the frame's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerceptiveFrameGains {
    /// Natural frequency of the plan towards the goal \[rad/s\], > 0.
    pub bandwidth_rad_s: f64,
    /// Damping ratio of the plan, >= 1.
    pub damping: f64,
    /// How fast the frame goes where the members are: `l` \[1/s\], >= 0.
    pub perception_gain_s: f64,
    /// Natural frequency of the platforms' own attitude loops: `w_m` \[rad/s\], > 0.
    pub member_bandwidth_rad_s: f64,
    /// Largest planned rate \[rad/s\], > 0.
    pub rate_max_rad_s: f64,
    /// Largest planned acceleration \[rad/s^2\], > 0.
    pub acceleration_max_rad_s2: f64,
}

impl PerceptiveFrameGains {
    fn plan(&self) -> PlanGains {
        let Self { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2, .. } = *self;
        PlanGains { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2 }
    }
}

/// The law.
#[derive(Debug, Clone, PartialEq)]
pub struct PerceptiveFrame {
    gains: PerceptiveFrameGains,
    /// Attitude, planned rate and acceleration.
    frame: Option<Reference>,
    progress_rad: f64,
}

impl PerceptiveFrame {
    /// A frame that starts where its members are.
    ///
    /// # Errors
    /// The first gain outside its proven range, with the bound.
    pub fn new(gains: PerceptiveFrameGains) -> Result<Self, LawError> {
        let law = Self::kind();
        gains.plan().check(law)?;
        require_positive(law, "member_bandwidth_rad_s", gains.member_bandwidth_rad_s)?;
        let (bound, value) = (2.0 * gains.member_bandwidth_rad_s, gains.perception_gain_s);
        if !(0.0..bound).contains(&value) {
            let allowed = format!("0 to less than {bound:.3}, twice the platforms' own bandwidth");
            return Err(LawError::Gain { law, gain: "perception_gain_s", value, allowed });
        }
        Ok(Self { gains, frame: None, progress_rad: 0.0 })
    }

    /// The frame's attitude, planned rate and acceleration; `None` before the first demand.
    #[must_use]
    pub fn frame(&self) -> Option<&Reference> {
        self.frame.as_ref()
    }

    /// Acceleration of the plan \[rad/s^2\].
    fn planned_rad_s2(&self, at: &Reference, goal: &Reference, dt_s: f64) -> Vector3<f64> {
        let g = &self.gains;
        let omega = at.omega_wr_r_rad_s;
        let (stiffness, damping) = (g.bandwidth_rad_s.powi(2), 2.0 * g.damping * g.bandwidth_rad_s);
        let error = attitude_error(&goal.q_world_reference, &at.q_world_reference);
        let saturated = limited(error, damping * g.rate_max_rad_s / stiffness);
        let q_frame_goal = at.q_world_reference.inverse() * goal.q_world_reference;
        let omega_goal = q_frame_goal * goal.omega_wr_r_rad_s;
        let omega_dot_goal = q_frame_goal * goal.omega_dot_wr_r_rad_s2 - omega.cross(&omega_goal);
        let asked = (-saturated * stiffness - (omega - omega_goal) * damping) / (1.0 + damping * dt_s);
        limited(asked + omega_dot_goal, g.acceleration_max_rad_s2)
    }

    /// Where the members are, seen from the frame \[rad\], frame axes. `None`: no member is seen.
    fn perceived_rad(at: &Reference, input: &LawInput<'_>) -> Option<Vector3<f64>> {
        let (mut sum, mut seen) = (Vector3::zeros(), 0.0);
        for (member, offset) in input.members.iter().zip(input.offsets) {
            if member.usable && member.tracking {
                let implied = member.q_world_body * offset.q_leader_platform.inverse();
                sum += attitude_error(&at.q_world_reference, &implied);
                seen += 1.0;
            }
        }
        (seen > 0.0).then(|| sum / seen)
    }
}

impl RelativeAttitudeLaw for PerceptiveFrame {
    fn kind() -> &'static str {
        "perceptive_frame"
    }

    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self> {
        settings.group(Self::kind(), |s| {
            let PlanGains { bandwidth_rad_s, damping, rate_max_rad_s, acceleration_max_rad_s2 } =
                PlanGains::read(s, roster, "frame", "damping ratio [1]");
            let gains = PerceptiveFrameGains {
                bandwidth_rad_s,
                damping,
                perception_gain_s: s.number_or(
                    "perception_gain_s",
                    1.0,
                    Allowed::NON_NEGATIVE,
                    "how fast the frame goes where the members are; below twice the platforms' bandwidth [1/s]",
                ),
                member_bandwidth_rad_s: s.member_bandwidth_rad_s(),
                rate_max_rad_s,
                acceleration_max_rad_s2,
            };
            s.accept(Self::new(gains), "perception_gain_s")
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
        self.frame = Some(structure_of_first(input));
        self.progress_rad = 0.0;
    }

    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>) {
        let mut frame =
            self.frame.map_or_else(|| structure_of_first(input), |last| last.extrapolated(input.dt_s));
        let goal = &input.goals.formation;
        let to_goal = attitude_error(&frame.q_world_reference, &goal.q_world_reference);
        let distance = to_goal.norm();
        let along = if distance > 1e-9 { to_goal / distance } else { Vector3::zeros() };
        match Self::perceived_rad(&frame, input) {
            Some(perceived) => {
                let progress = perceived.dot(&along) * distance / (distance + NEAR_RAD);
                let share = PROGRESS_POLE_S * input.dt_s / (1.0 + PROGRESS_POLE_S * input.dt_s);
                self.progress_rad += share * (progress - self.progress_rad);
                frame.omega_dot_wr_r_rad_s2 = self.planned_rad_s2(&frame, goal, input.dt_s);
            }
            // No member is seen: the plan brakes to rest.
            None => {
                self.progress_rad = 0.0;
                let stop = -frame.omega_wr_r_rad_s / input.dt_s.max(1e-6);
                frame.omega_dot_wr_r_rad_s2 = limited(stop, self.gains.acceleration_max_rad_s2);
            }
        }
        let perceived_rad_s = along * (self.gains.perception_gain_s * self.progress_rad);
        frame.q_world_reference *= quaternion_exp(&(perceived_rad_s * input.dt_s));
        self.frame = Some(frame);
        let shown = Reference { omega_wr_r_rad_s: frame.omega_wr_r_rad_s + perceived_rad_s, ..frame };
        demands.clear();
        demands.extend(input.members.iter().enumerate().map(|(platform, member)| {
            match input.offsets.get(platform) {
                Some(offset) if member.usable => MotionDemand::Follow(offset.apply(&shown)),
                _ => MotionDemand::Hold,
            }
        }));
    }

    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation> {
        rigid_relation(input, platform)
    }
}
