//! The relative-attitude law.

use nalgebra::UnitQuaternion;
use whorl_control::formation::{
    LeaderFollower, LeaderGraph, ReferenceLimits, RelativeAttitudeLaw, VirtualStructure,
    VirtualStructureGains, YawPitchRoll,
};
use whorl_params::{Reader, positive, range};

/// Share of the tightest platform's limits that a virtual structure uses by default: its members
/// need the rest to catch up.
const STRUCTURE_SHARE: f64 = 0.8;

/// The law and the offsets it begins with.
#[derive(Debug, Clone, PartialEq)]
pub struct LawSettings {
    /// Which law.
    pub kind: LawKind,
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
}

impl LawSettings {
    /// A new instance of the law.
    #[must_use]
    pub fn build(&self) -> Box<dyn RelativeAttitudeLaw> {
        match &self.kind {
            LawKind::LeaderFollower(graph) => Box::new(LeaderFollower::new(graph.clone())),
            LawKind::VirtualStructure(structure) => Box::new(structure.clone()),
        }
    }

    /// The commanded offset of a platform.
    #[must_use]
    pub fn offset(&self, platform: usize) -> UnitQuaternion<f64> {
        self.offsets.get(platform).map_or_else(UnitQuaternion::identity, YawPitchRoll::attitude)
    }

    /// Whether the platform takes its motion from the experiment's steps.
    #[must_use]
    pub fn leads(&self, platform: usize) -> bool {
        match &self.kind {
            LawKind::LeaderFollower(graph) => graph.leader(platform).is_none(),
            LawKind::VirtualStructure(_) => false,
        }
    }

    /// Whether steps move one virtual structure, not platforms.
    #[must_use]
    pub fn moves_a_structure(&self) -> bool {
        matches!(self.kind, LawKind::VirtualStructure(_))
    }
}

pub(super) fn read(
    r: &mut Reader<'_>,
    platforms: &[String],
    limits: &[ReferenceLimits],
) -> Option<LawSettings> {
    let kind = r.choice_or(
        "kind",
        "leader_follower",
        &["leader_follower", "virtual_structure"],
        "the relative-attitude law",
    );
    for name in r.children("members") {
        if !platforms.contains(&name) {
            r.reject(
                &format!("members.{name}"),
                format!("`{name}` is no platform; allowed: {}", platforms.join(", ")),
            );
        }
    }
    let structure = kind == "virtual_structure";
    let members: Vec<_> = platforms
        .iter()
        .enumerate()
        .map(|(index, platform)| {
            r.group(&format!("members.{platform}"), |r| {
                let leader = if structure { None } else { read_leader(r, index, platforms) };
                (leader, r.group("offset", read_angles))
            })
        })
        .collect();
    let offsets = members.iter().map(|(_, offset)| *offset).collect();
    let kind = if structure {
        r.group("virtual_structure", |r| read_structure(r, limits)).map(LawKind::VirtualStructure)
    } else {
        let leaders = members.iter().map(|(leader, _)| *leader).collect();
        match LeaderGraph::new(leaders) {
            Ok(graph) => Some(LawKind::LeaderFollower(graph)),
            Err(e) => {
                r.reject("members", e.to_string());
                None
            }
        }
    };
    Some(LawSettings { kind: kind?, offsets })
}

/// The first platform leads and all others follow it, unless the file says otherwise.
fn read_leader(r: &mut Reader<'_>, index: usize, platforms: &[String]) -> Option<usize> {
    let first = platforms.first().map_or("", String::as_str);
    let default = if index == 0 { "" } else { first };
    let leader = r.string_or("leader", default, "the platform that this one follows; empty: it leads itself");
    let found = platforms.iter().position(|platform| *platform == leader);
    if found.is_none() && !leader.is_empty() {
        r.reject("leader", format!("`{leader}` is no platform; allowed: {}", platforms.join(", ")));
    }
    found
}

fn read_angles(r: &mut Reader<'_>) -> YawPitchRoll {
    let mut angle = |key, doc| r.f64_or(key, 0.0, range(-180.0..=180.0), doc).to_radians();
    YawPitchRoll {
        yaw_rad: angle("yaw_deg", "commanded yaw relative to the leader, about its z axis [deg]"),
        pitch_rad: angle("pitch_deg", "then pitch about the new y axis, positive nose down [deg]"),
        roll_rad: angle("roll_deg", "then roll about the new x axis [deg]"),
    }
}

fn read_structure(r: &mut Reader<'_>, limits: &[ReferenceLimits]) -> Option<VirtualStructure> {
    let tightest = |of: fn(&ReferenceLimits) -> f64| {
        limits.iter().map(of).fold(f64::INFINITY, f64::min).to_degrees().min(60.0) * STRUCTURE_SHARE
    };
    let rate_max_rad_s = r
        .f64_or(
            "rate_max_deg_s",
            tightest(|l| l.rate_max_rad_s),
            positive(),
            "largest rate of the structure; default: 0.8 of the slowest platform's limit [deg/s]",
        )
        .to_radians();
    let acceleration_max_rad_s2 = r
        .f64_or(
            "acceleration_max_deg_s2",
            tightest(|l| l.acceleration_max_rad_s2),
            positive(),
            "largest acceleration of the structure; default: 0.8 of the weakest platform's limit [deg/s^2]",
        )
        .to_radians();
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
    VirtualStructure::new(gains).map_err(|e| r.reject("bandwidth_rad_s", e.to_string())).ok()
}
