//! What each platform is in the formation: whom it follows or listens to, where its place is.

use whorl_control::formation::{KeepOut, Listening, YawPitchRoll};
use whorl_params::{Reader, non_negative, positive, range};

/// One platform's place in the formation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    /// Whom it follows.
    pub leader: Option<usize>,
    /// Its commanded angles relative to its leader, or to the virtual structure.
    pub offset: YawPitchRoll,
    /// Whom it keeps formation with, for behaviours.
    pub ring: Vec<usize>,
    /// Whom it listens to, for the decentralised law.
    pub listening: Listening,
    /// What its boresight stays away from.
    pub keep_out: Option<KeepOut>,
}

/// Reads the keys that the laws of the experiment use.
pub(super) fn read(r: &mut Reader<'_>, index: usize, platforms: &[String], kinds: &[&str]) -> Member {
    let uses = |kind: &str| kinds.contains(&kind);
    let count = platforms.len();
    let all: Vec<usize> = (0..count).filter(|p| *p != index).collect();
    // Neighbours in a ring: the one before and the one after.
    let mut ring = vec![(index + count - 1) % count.max(1), (index + 1) % count.max(1)];
    ring.dedup();
    ring.retain(|p| *p != index);
    let named =
        if uses("behavioural") || uses("decentralised") { read_neighbours(r, platforms) } else { None };
    let goal_weight = if uses("decentralised") {
        r.f64_or(
            "goal_weight",
            1.0,
            non_negative(),
            "weight of the experiment's goal against 1 of each neighbour; 0: the platform does not know it",
        )
    } else {
        0.0
    };
    Member {
        leader: if uses("leader_follower") { read_leader(r, index, platforms) } else { None },
        offset: r.group("offset", read_angles),
        ring: named.clone().unwrap_or(ring),
        listening: Listening {
            neighbours: named.unwrap_or(all).into_iter().map(|p| (p, 1.0)).collect(),
            goal_weight,
        },
        keep_out: if uses("behavioural") && !r.children("keep_out").is_empty() {
            Some(r.group("keep_out", read_keep_out))
        } else {
            None
        },
    }
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

fn read_neighbours(r: &mut Reader<'_>, platforms: &[String]) -> Option<Vec<usize>> {
    if !r.has("neighbours") {
        return None;
    }
    let names = r.string_array(
        "neighbours",
        "platforms that this one listens to; left out: all others (decentralised), those beside it in a ring \
         (behavioural)",
    );
    let mut found = Vec::with_capacity(names.len());
    for name in &names {
        match platforms.iter().position(|platform| platform == name) {
            Some(index) => found.push(index),
            None => {
                r.reject("neighbours", format!("`{name}` is no platform; allowed: {}", platforms.join(", ")))
            }
        }
    }
    Some(found)
}

fn read_angles(r: &mut Reader<'_>) -> YawPitchRoll {
    let mut angle = |key, doc| r.f64_or(key, 0.0, range(-180.0..=180.0), doc).to_radians();
    YawPitchRoll {
        yaw_rad: angle("yaw_deg", "commanded yaw relative to the leader, about its z axis [deg]"),
        pitch_rad: angle("pitch_deg", "then pitch about the new y axis, positive nose down [deg]"),
        roll_rad: angle("roll_deg", "then roll about the new x axis [deg]"),
    }
}

fn read_keep_out(r: &mut Reader<'_>) -> KeepOut {
    KeepOut {
        boresight_body: r.direction("boresight_body", "body axis that must stay away, e.g. [1.0, 0.0, 0.0]"),
        direction_world: r.direction("direction_world", "direction that it stays away from (east, north, up)"),
        half_angle_rad: r
            .f64("half_angle_deg", range(0.1..=80.0), "half angle of the forbidden cone [deg]")
            .to_radians(),
        influence_rad: r
            .f64(
                "influence_deg",
                positive(),
                "distance from the cone at which avoidance begins; at least rate_max^2 / acceleration_max [deg]",
            )
            .to_radians(),
        bandwidth_rad_s: r.f64_or("bandwidth_rad_s", 0.1, range(0.0..=2.0), "weight of the avoidance [rad/s]"),
    }
}
