//! Decentralised: each platform follows the mean of its neighbours; none commands the others.
//!
//! # Equations
//!
//! The formation has a frame without an owner. Platform j, at its offset, implies where that frame is:
//! `F_j = x_j o_j^-1`, with attitude, rate and acceleration. Platform i is asked for
//!
//! ```text
//! q_i = F_i o_i,   F_i = F exp( a_i0 log(F^-1 G) + sum_j a_ij log(F^-1 F_j) ),   F: its own current frame
//! omega_i, omega'_i: the same weighted means of rates and accelerations, in the axes of F_i
//! ```
//!
//! over its neighbours j and, if it knows it, the experiment's goal G; the weights of a platform add up to
//! one. A neighbour's motion is its reference with a share `c` of its own pointing error:
//! `x_j = q_ref exp(c log(q_ref^-1 q_est))`. Its acceleration counts with the factor 0.9 (see below). A
//! neighbour that is not heard drops out and the other weights grow to one again.
//!
//! Run in one process, or on each platform with what it hears: a platform's demand depends on nothing but
//! itself, its neighbours and the goal.
//!
//! # Source
//! W. Ren, "Multi-vehicle consensus with a time-varying reference state", Systems & Control Letters 56,
//! 2007, here second order and on SO(3) as in W. Ren, "Distributed attitude alignment in spacecraft formation
//! flying", Int. J. Adaptive Control and Signal Processing 21, 2007; M. C. VanDyke, C. D. Hall, "Decentralized
//! coordinated attitude control within a formation of spacecraft", J. Guidance, Control, and Dynamics 29(5),
//! 2006. Schwartz 2004, section 2.4.
//!
//! # Stability
//! Each demand passes a shaper that, inside its limits, is `(s + w)^2 x_i = s^2 a_i + 2 w s v_i + w^2 q_i` for a demand
//! with acceleration a, rate v and attitude q. Of what neighbours show, accelerations count with the factor `e = 0.9` and
//! rates with the factor `b`. For `c = 0` the linear loop of all deviations from the goal is
//!
//! ```text
//! (s + w)^2 x = (e s^2 + 2 b w s + w^2) A(s) x,    A(s)_ij = a_ij e^(-s tau_ij)
//! ```
//!
//! with any delay `tau_ij` on each link. `G = (e s^2 + 2 b w s + w^2)/(s + w)^2` has no pole in the right half-plane and its
//! largest value on the imaginary axis is `g = 1.0127` for `b = 1`, and exactly 1 for `b = sqrt((1 + e)/2) = 0.9747`:
//! `(w^2 - e W^2)^2 + 4 b^2 w^2 W^2 <= (w^2 + W^2)^2` at every frequency W needs `4 b^2 - 2 e <= 2`. The matrix of the
//! moduli of `G A(s)` is at most `g A`, so by the small-gain theorem the loop is exponentially stable for every delay if
//!
//! ```text
//! g rho < 1,    rho: spectral radius of the neighbours' weights A
//! ```
//!
//! which is below 1 because the goal reaches all platforms ([`super::NeighbourGraph`] refuses other graphs). A graph with
//! `rho < 1/1.0127 = 0.987` takes `b = 1`; any other (a ring of 20 of which one knows the goal has `rho = 0.991` and
//! would ring with `b = 1` at a delay of `4.68/w`) takes `b = 0.9747`, at the price of a lag of `0.05/w` a hop behind a turning
//! formation. `e` lets a group that lost the goal come to rest instead of echoing itself.
//!
//! For `c > 0` a platform's loop T stands inside the mean and adds `c (T - 1) w^2/(s + w)^2`: with `|T - 1| <= 1.3` at all
//! frequencies the same theorem asks for `rho (g + 1.3 c) < 1`. What `b = 1` does not allow takes `b = 0.9747`, for which
//! g = 1, and [`Decentralised::new`] refuses `c` of (1 - rho)/(1.3 rho) and more. Platforms
//! may have different `w`. All of this is linear: limits of the shapers and large turns are outside of it.
//!
//! # Assumptions
//! All frames lie within a half turn of each other (the mean is then unique); one clock.

use nalgebra::Vector3;
use whorl_math::{attitude_error, quaternion_exp};

use super::law::rigid_relation;
use super::traffic::{self, Told, TrafficCap};
use super::{
    Allowed, MotionDemand, LawError, LawInput, Listening, Member, NeighbourGraph, Offset, Relation,
    RelativeAttitudeLaw, Roster, Settings,
};
use crate::reference::Reference;

/// Largest `|T - 1|` of a platform's attitude loop that the bound allows for.
const LOOP_PEAK: f64 = 1.3;
/// Share of a neighbour's acceleration that is passed on: `e`.
const ECHO: f64 = 0.9;
/// Largest gain of a shaper with that share and all of the rate: `sqrt(1 + max_x (0.2 x - 0.19 x^2)/(1 + x)^2)`.
const SHAPER_PEAK: f64 = 1.0128;
/// Spectral radii below this count as zero: a forest.
const FOREST_RADIUS: f64 = 0.05;
/// Share of the proven bound of `c` that is its default.
const ERROR_SHARE_OF_BOUND: f64 = 0.5;

/// What can be set.
#[derive(Debug, Clone, PartialEq)]
pub struct DecentralisedSettings {
    /// Who listens to whom, and who knows the goal.
    pub graph: NeighbourGraph,
    /// Share of a neighbour's pointing error that is followed: `c`, 0 to 1.
    pub error_share: f64,
    /// A cap on the broadcasts of platforms; `None`: no cap.
    pub traffic: Option<TrafficCap>,
}

/// The law.
#[derive(Debug, Clone, PartialEq)]
pub struct Decentralised {
    settings: DecentralisedSettings,
    /// `b` of this graph.
    rate_share: f64,
    told: Vec<Option<Told>>,
    broadcasts: u64,
}

impl Decentralised {
    /// A law over this graph.
    ///
    /// # Errors
    /// A share beyond its proven bound, or an invalid traffic cap.
    pub fn new(settings: DecentralisedSettings) -> Result<Self, LawError> {
        let bound = Self::error_share_bound(&settings.graph);
        let value = settings.error_share;
        if !(0.0..=1.0).contains(&value) || value >= bound {
            let allowed = if bound > 1.0 {
                "0 to 1".to_owned()
            } else {
                format!("0 to less than {bound:.3}, (1 - rho) / (1.3 rho) of this graph")
            };
            return Err(LawError::Gain { law: "decentralised", gain: "error_share", value, allowed });
        }
        if let Some(cap) = &settings.traffic {
            cap.check("decentralised")?;
        }
        let told = vec![None; settings.graph.len()];
        let rate_share = Self::rate_share(&settings.graph, settings.error_share);
        Ok(Self { settings, rate_share, told, broadcasts: 0 })
    }

    /// The share of errors below which the law is proven stable; above 1 for a forest.
    #[must_use]
    pub fn error_share_bound(graph: &NeighbourGraph) -> f64 {
        let rho = graph.spectral_radius();
        if rho < FOREST_RADIUS { f64::INFINITY } else { (1.0 - rho) / (LOOP_PEAK * rho) }
    }

    /// Share of a neighbour's rate that is passed on, `b`: all of it where that is stable at every delay.
    fn rate_share(graph: &NeighbourGraph, error_share: f64) -> f64 {
        let with_all = graph.spectral_radius() * (SHAPER_PEAK + LOOP_PEAK * error_share);
        if with_all < 1.0 { 1.0 } else { (0.5 * (1.0 + ECHO)).sqrt() }
    }

    /// Who listens to whom.
    #[must_use]
    pub fn graph(&self) -> &NeighbourGraph {
        &self.settings.graph
    }

    /// What a platform shows of its motion.
    fn shown(&self, member: &Member) -> Reference {
        if !member.tracking {
            return Reference {
                q_world_reference: member.q_world_body,
                omega_wr_r_rad_s: member.omega_wb_b_rad_s,
                omega_dot_wr_r_rad_s2: Vector3::zeros(),
            };
        }
        let error = attitude_error(&member.reference.q_world_reference, &member.q_world_body);
        let q = member.reference.q_world_reference * quaternion_exp(&(error * self.settings.error_share));
        Reference { q_world_reference: q, ..member.reference }
    }

    /// What the neighbours know of a platform.
    fn heard(&self, input: &LawInput<'_>, platform: usize) -> Option<Reference> {
        let member = input.members.get(platform).filter(|m| m.usable)?;
        match self.settings.traffic {
            None => Some(self.shown(member)),
            Some(_) => self.told.get(platform)?.as_ref().map(Told::believed),
        }
    }

    fn demand(&self, input: &LawInput<'_>, platform: usize) -> MotionDemand {
        let (Some(own), Some(offset)) = (input.members.get(platform), input.offsets.get(platform)) else {
            return MotionDemand::Hold;
        };
        if !own.usable {
            return MotionDemand::Hold;
        }
        let present = offset.inverse().apply(&own.reference).q_world_reference;
        let graph = &self.settings.graph;
        let neighbours = graph.neighbours(platform).iter().filter_map(|(neighbour, weight)| {
            let motion = self.heard(input, *neighbour)?;
            let frame = input.offsets.get(*neighbour).map(Offset::inverse)?.apply(&motion);
            let omega_wr_r_rad_s = frame.omega_wr_r_rad_s * self.rate_share;
            let omega_dot_wr_r_rad_s2 = frame.omega_dot_wr_r_rad_s2 * ECHO;
            Some((Reference { omega_wr_r_rad_s, omega_dot_wr_r_rad_s2, ..frame }, *weight))
        });
        let goal = Some((input.goals.formation, graph.goal_weight(platform))).filter(|(_, w)| *w > 0.0);
        let sources: Vec<(Reference, f64)> = goal.into_iter().chain(neighbours).collect();
        let total: f64 = sources.iter().map(|(_, weight)| weight).sum();
        if total <= 0.0 {
            return MotionDemand::Hold;
        }
        let mut turn = Vector3::zeros();
        for (frame, weight) in &sources {
            turn += attitude_error(&present, &frame.q_world_reference) * (weight / total);
        }
        let q = present * quaternion_exp(&turn);
        let (mut omega, mut omega_dot) = (Vector3::zeros(), Vector3::zeros());
        for (frame, weight) in &sources {
            let to_mean = q.inverse() * frame.q_world_reference;
            omega += to_mean * frame.omega_wr_r_rad_s * (weight / total);
            omega_dot += to_mean * frame.omega_dot_wr_r_rad_s2 * (weight / total);
        }
        let frame =
            Reference { q_world_reference: q, omega_wr_r_rad_s: omega, omega_dot_wr_r_rad_s2: omega_dot };
        MotionDemand::Follow(offset.apply(&frame))
    }
}

impl RelativeAttitudeLaw for Decentralised {
    fn kind() -> &'static str {
        "decentralised"
    }

    /// A platform listens to all others and knows the goal, unless its settings say otherwise.
    fn read(settings: &mut dyn Settings, roster: &Roster<'_>) -> Option<Self> {
        let listening = settings.members(roster, |s, platform| {
            let neighbours = s.neighbours().unwrap_or_else(|| roster.others(platform));
            let goal_weight = s.number_or(
                "goal_weight",
                1.0,
                Allowed::NON_NEGATIVE,
                "weight of the experiment's goal against 1 of each neighbour; 0: the platform does not know it",
            );
            Listening { neighbours: neighbours.into_iter().map(|p| (p, 1.0)).collect(), goal_weight }
        });
        let graph = NeighbourGraph::new(&listening);
        settings.group(Self::kind(), |s| {
            let bound = graph.as_ref().map_or(0.0, Self::error_share_bound);
            let error_share = s.number_or(
                "error_share",
                (ERROR_SHARE_OF_BOUND * bound).min(1.0),
                Allowed::between(0.0, 1.0),
                "share of a neighbour's pointing error that is followed; default: half of what the graph allows [1]",
            );
            let traffic = s.group("traffic", TrafficCap::read);
            // After all keys are read: an invalid graph is one error, not one for each of them.
            let graph = graph.map_err(|e| s.reject("error_share", e.to_string())).ok()?;
            s.accept(Self::new(DecentralisedSettings { graph, error_share, traffic }), "error_share")
        })
    }

    fn moves_a_structure(&self) -> bool {
        true
    }

    fn plans_its_way(&self) -> bool {
        false
    }

    fn needs_all(&self) -> bool {
        false
    }

    fn runs_on_platforms() -> bool {
        true
    }

    fn hears(&self, platform: usize, other: usize) -> bool {
        self.settings.graph.neighbours(platform).iter().any(|(neighbour, _)| *neighbour == other)
    }

    fn restart(&mut self, _input: &LawInput<'_>) {
        self.told.fill(None);
    }

    fn demands(&mut self, input: &LawInput<'_>, demands: &mut Vec<MotionDemand>) {
        if let Some(cap) = self.settings.traffic {
            for platform in 0..self.told.len() {
                let Some(member) = input.members.get(platform).filter(|m| m.usable) else {
                    self.told[platform] = None;
                    continue;
                };
                let motion = self.shown(member);
                if traffic::update(&mut self.told[platform], &motion, input.dt_s, &cap) {
                    self.broadcasts += 1;
                }
            }
        }
        demands.clear();
        demands.extend((0..input.members.len()).map(|platform| self.demand(input, platform)));
    }

    fn relation(&self, input: &LawInput<'_>, platform: usize) -> Option<Relation> {
        rigid_relation(input, platform)
    }

    fn broadcasts(&self) -> Option<u64> {
        self.settings.traffic.map(|_| self.broadcasts)
    }
}
