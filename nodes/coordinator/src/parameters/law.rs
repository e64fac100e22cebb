//! The relative-attitude laws of an experiment.

mod distributed;
mod members;

use nalgebra::UnitQuaternion;
use whorl_control::formation::{
    Behavioural, Decentralised, LeaderFollower, LeaderGraph, PerceptiveFrame, ReferenceLimits,
    RelativeAttitudeLaw, VirtualStructure, VirtualStructureGains, YawPitchRoll,
};
use whorl_params::{Reader, positive, range};

use super::refusals;
use members::Member;

/// Share of the tightest platform's limits that a virtual structure uses by default: its members
/// need the rest to catch up.
const STRUCTURE_SHARE: f64 = 0.8;

/// The laws of an experiment and the offsets it begins with.
#[derive(Debug, Clone, PartialEq)]
pub struct LawSettings {
    /// The laws that the experiment uses; it begins with the first. At least one.
    pub laws: Vec<LawKind>,
    /// Commanded angles of each platform relative to its leader, or to the virtual structure.
    pub offsets: Vec<YawPitchRoll>,
}

/// A law with its settings.
#[derive(Debug, Clone, PartialEq)]
pub enum LawKind {
    /// Followers take their leader's estimated attitude.
    LeaderFollower(LeaderGraph),
    /// All hang on a virtual body.
    VirtualStructure(VirtualStructure),
    /// Weighted behaviours of each platform.
    Behavioural(Behavioural),
    /// The mean of neighbours and goal.
    Decentralised(Decentralised),
    /// A frame that moves by what is perceived.
    PerceptiveFrame(PerceptiveFrame),
}

/// Names of the laws, as `law.kind` has them.
pub(super) const KINDS: [&str; 5] =
    ["leader_follower", "virtual_structure", "behavioural", "decentralised", "perceptive_frame"];

impl LawKind {
    /// A new instance of the law.
    #[must_use]
    pub fn build(&self) -> Box<dyn RelativeAttitudeLaw> {
        match self {
            Self::LeaderFollower(graph) => Box::new(LeaderFollower::new(graph.clone())),
            Self::VirtualStructure(law) => Box::new(law.clone()),
            Self::Behavioural(law) => Box::new(law.clone()),
            Self::Decentralised(law) => Box::new(law.clone()),
            Self::PerceptiveFrame(law) => Box::new(law.clone()),
        }
    }

    /// Its name, as `law.kind` has it.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::LeaderFollower(_) => "leader_follower",
            Self::VirtualStructure(_) => "virtual_structure",
            Self::Behavioural(_) => "behavioural",
            Self::Decentralised(_) => "decentralised",
            Self::PerceptiveFrame(_) => "perceptive_frame",
        }
    }

    /// Whether the platform takes its motion from the experiment's steps.
    #[must_use]
    pub fn leads(&self, platform: usize) -> bool {
        match self {
            Self::LeaderFollower(graph) => graph.leader(platform).is_none(),
            _ => false,
        }
    }

    /// The platform's leader, if it follows one.
    #[must_use]
    pub fn leader(&self, platform: usize) -> Option<usize> {
        match self {
            Self::LeaderFollower(graph) => graph.leader(platform),
            _ => None,
        }
    }

    /// Whether steps move one frame of the whole formation, not platforms.
    #[must_use]
    pub fn moves_a_structure(&self) -> bool {
        !matches!(self, Self::LeaderFollower(_))
    }

    /// Whether the law finds its own way to a goal that is set at once.
    #[must_use]
    pub fn plans_its_way(&self) -> bool {
        matches!(self, Self::VirtualStructure(_) | Self::Behavioural(_) | Self::PerceptiveFrame(_))
    }

    /// Whether the formation cannot go on without one of its members.
    #[must_use]
    pub fn needs_all(&self) -> bool {
        matches!(self, Self::VirtualStructure(law) if law.waits_for_members())
    }
}

impl LawSettings {
    /// The law that the experiment begins with.
    #[must_use]
    pub fn first(&self) -> Option<&LawKind> {
        self.laws.first()
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.first().map_or("", LawKind::name)
    }

    /// The commanded offset of a platform.
    #[must_use]
    pub fn offset(&self, platform: usize) -> UnitQuaternion<f64> {
        self.offsets.get(platform).map_or_else(UnitQuaternion::identity, YawPitchRoll::attitude)
    }
}

/// Reads the law that the experiment begins with, and those `others` that its steps switch to.
pub(super) fn read(
    r: &mut Reader<'_>,
    platforms: &[String],
    limits: &[ReferenceLimits],
    others: &[String],
) -> Option<LawSettings> {
    let kind = r.choice_or("kind", "leader_follower", &KINDS, "the relative-attitude law");
    let others = KINDS.iter().copied().filter(|k| *k != kind && others.iter().any(|o| o == k));
    let kinds: Vec<&str> = std::iter::once(kind).chain(others).collect();
    for name in r.children("members") {
        if !platforms.contains(&name) {
            r.reject(
                &format!("members.{name}"),
                format!("`{name}` is no platform; allowed: {}", platforms.join(", ")),
            );
        }
    }
    let members: Vec<Member> = platforms
        .iter()
        .enumerate()
        .map(|(index, platform)| {
            r.group(&format!("members.{platform}"), |r| members::read(r, index, platforms, &kinds))
        })
        .collect();
    let laws =
        kinds.iter().filter_map(|kind| read_law(r, kind, &members, limits, platforms)).collect::<Vec<_>>();
    (laws.len() == kinds.len())
        .then(|| LawSettings { laws, offsets: members.iter().map(|m| m.offset).collect() })
}

fn read_law(
    r: &mut Reader<'_>,
    kind: &str,
    members: &[Member],
    limits: &[ReferenceLimits],
    platforms: &[String],
) -> Option<LawKind> {
    match kind {
        "leader_follower" => {
            let graph = LeaderGraph::new(members.iter().map(|m| m.leader).collect());
            graph
                .map_err(|e| r.reject("members", refusals::with_names(&e.to_string(), platforms)))
                .ok()
                .map(LawKind::LeaderFollower)
        }
        "virtual_structure" => {
            r.group(kind, |r| read_structure(r, limits, platforms)).map(LawKind::VirtualStructure)
        }
        "behavioural" => r
            .group(kind, |r| distributed::behavioural(r, members, limits, platforms))
            .map(LawKind::Behavioural),
        "decentralised" => {
            r.group(kind, |r| distributed::decentralised(r, members, platforms)).map(LawKind::Decentralised)
        }
        _ => r
            .group(kind, |r| distributed::perceptive_frame(r, limits, platforms))
            .map(LawKind::PerceptiveFrame),
    }
}

fn read_structure(
    r: &mut Reader<'_>,
    limits: &[ReferenceLimits],
    platforms: &[String],
) -> Option<VirtualStructure> {
    let (rate_max_rad_s, acceleration_max_rad_s2) = read_motion_limits(r, limits);
    let gains = VirtualStructureGains {
        bandwidth_rad_s: r.f64_or(
            "bandwidth_rad_s",
            0.3,
            positive(),
            "natural frequency of the structure towards its goal; at most 2.718 acceleration / rate [rad/s]",
        ),
        damping: r.f64_or("damping", 1.0, range(1.0..=10.0), "damping ratio without feedback [1]"),
        half_speed_error_rad: r
            .f64_or(
                "half_speed_error_deg",
                1.0,
                range(0.01..).or_not_finite(),
                "formation feedback: RMS error of the members at which the structure turns at half \
                 speed; .inf: open loop [deg]",
            )
            .to_radians(),
        rate_max_rad_s,
        acceleration_max_rad_s2,
    };
    VirtualStructure::new(gains).map_err(|e| refusals::law(r, &e, "bandwidth_rad_s", platforms)).ok()
}

/// Largest rate \[rad/s\] and acceleration \[rad/s^2\] of a law's own motion.
fn read_motion_limits(r: &mut Reader<'_>, limits: &[ReferenceLimits]) -> (f64, f64) {
    let tightest = |of: fn(&ReferenceLimits) -> f64| {
        limits.iter().map(of).fold(f64::INFINITY, f64::min).to_degrees().min(60.0) * STRUCTURE_SHARE
    };
    let rate_max_deg_s = r.f64_or(
        "rate_max_deg_s",
        tightest(|l| l.rate_max_rad_s),
        positive(),
        "largest rate of the law's own motion; default: 0.8 of the slowest platform's limit [deg/s]",
    );
    let acceleration_max_deg_s2 = r.f64_or(
        "acceleration_max_deg_s2",
        tightest(|l| l.acceleration_max_rad_s2),
        positive(),
        "largest acceleration of the law's own motion; default: 0.8 of the weakest platform's limit [deg/s^2]",
    );
    (rate_max_deg_s.to_radians(), acceleration_max_deg_s2.to_radians())
}
