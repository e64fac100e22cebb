//! Laws that weigh what several platforms do.

use whorl_control::formation::{
    Behavioural, BehaviouralSettings, Decentralised, DecentralisedSettings, NeighbourGraph, PerceptiveFrame,
    PerceptiveFrameGains, ReferenceLimits, TrafficCap,
};
use whorl_params::{Reader, non_negative, positive, range};

use super::super::refusals;
use super::members::Member;
use super::read_motion_limits;

/// Share of the proven bound that is the default.
const ERROR_SHARE_OF_BOUND: f64 = 0.5;

fn read_member_bandwidth(r: &mut Reader<'_>) -> f64 {
    r.f64_or(
        "member_bandwidth_rad_s",
        0.8,
        positive(),
        "natural frequency of the platforms' own attitude loops: 2 with wheels, 0.8 with jets [rad/s]",
    )
}

fn read_damping(r: &mut Reader<'_>) -> f64 {
    r.f64_or("damping", 1.0, range(1.0..=10.0), "damping ratio [1]")
}

pub(super) fn behavioural(
    r: &mut Reader<'_>,
    members: &[Member],
    limits: &[ReferenceLimits],
    platforms: &[String],
) -> Option<Behavioural> {
    let (rate_max_rad_s, acceleration_max_rad_s2) = read_motion_limits(r, limits);
    let settings = BehaviouralSettings {
        goal_bandwidth_rad_s: r.f64_or(
            "goal_bandwidth_rad_s",
            0.3,
            positive(),
            "weight of goal-seeking; at most 2.718 acceleration / rate [rad/s]",
        ),
        keeping_bandwidth_rad_s: r.f64_or(
            "keeping_bandwidth_rad_s",
            0.3,
            non_negative(),
            "weight of formation-keeping towards each neighbour; at most half the platforms' bandwidth [rad/s]",
        ),
        damping: read_damping(r),
        rate_max_rad_s,
        acceleration_max_rad_s2,
        member_bandwidth_rad_s: read_member_bandwidth(r),
        neighbours: members.iter().map(|m| m.ring.clone()).collect(),
        keep_out: members.iter().map(|m| m.keep_out).collect(),
    };
    Behavioural::new(settings).map_err(|e| refusals::law(r, &e, "goal_bandwidth_rad_s", platforms)).ok()
}

pub(super) fn decentralised(
    r: &mut Reader<'_>,
    members: &[Member],
    platforms: &[String],
) -> Option<Decentralised> {
    let listening: Vec<_> = members.iter().map(|m| m.listening.clone()).collect();
    let graph = NeighbourGraph::new(&listening);
    let bound = graph.as_ref().map_or(0.0, Decentralised::error_share_bound);
    let error_share = r.f64_or(
        "error_share",
        (ERROR_SHARE_OF_BOUND * bound).min(1.0),
        range(0.0..=1.0),
        "share of a neighbour's pointing error that is followed; default: half of what the graph allows [1]",
    );
    let traffic = r.group("traffic", |r| {
        let rate_max_hz = r.f64_or(
            "rate_max_hz",
            0.0,
            non_negative(),
            "cap on a platform's broadcasts to its neighbours; 0: none, they hear everything [1/s]",
        );
        let trigger_rad = r
            .f64_or(
                "trigger_deg",
                0.1,
                positive(),
                "a platform speaks when its neighbours are wrong by this [deg]",
            )
            .to_radians();
        let heartbeat_s = r.f64_or("heartbeat_s", 1.0, positive(), "and after this long in any case [s]");
        (rate_max_hz > 0.0).then_some(TrafficCap { rate_max_hz, trigger_rad, heartbeat_s })
    });
    // After all keys are read: a graph that is none is one error, not one for each of them.
    let graph =
        graph.map_err(|e| r.reject("error_share", refusals::with_names(&e.to_string(), platforms))).ok()?;
    let settings = DecentralisedSettings { graph, error_share, traffic };
    Decentralised::new(settings).map_err(|e| refusals::law(r, &e, "error_share", platforms)).ok()
}

pub(super) fn perceptive_frame(
    r: &mut Reader<'_>,
    limits: &[ReferenceLimits],
    platforms: &[String],
) -> Option<PerceptiveFrame> {
    let (rate_max_rad_s, acceleration_max_rad_s2) = read_motion_limits(r, limits);
    let gains = PerceptiveFrameGains {
        bandwidth_rad_s: r.f64_or(
            "bandwidth_rad_s",
            0.3,
            positive(),
            "natural frequency of the plan towards the goal; at most 2.718 acceleration / rate [rad/s]",
        ),
        damping: read_damping(r),
        perception_gain_s: r.f64_or(
            "perception_gain_s",
            1.0,
            non_negative(),
            "how fast the frame goes where the members are; below twice the platforms' bandwidth [1/s]",
        ),
        member_bandwidth_rad_s: read_member_bandwidth(r),
        rate_max_rad_s,
        acceleration_max_rad_s2,
    };
    PerceptiveFrame::new(gains).map_err(|e| refusals::law(r, &e, "perception_gain_s", platforms)).ok()
}
