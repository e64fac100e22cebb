//! Fault row: the link between two computers is cut for a minute. Both sides rejoin without a restart, and
//! data between nodes on the same side keeps flowing: in the cut, and when endpoints are renewed after it.
//!
//! Needs root and `ip` (iproute2) for two network namespaces, and takes a minute and a half.

use std::time::{Duration, Instant};

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
use whorl_node::Timestamp;
use whorl_ros::environment::Network;
use whorl_security::policy::MONITOR;

use crate::support::formation::{Formation, LONG_HOLD, STARTUP};
use crate::support::network::Lan;
use crate::support::watch::{Watch, route};
use crate::support::{measured, skipped};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];
/// Longer than DDS's lease of 50 s, so that the other side is dropped.
const CUT: Duration = Duration::from_secs(65);
/// Until a cut is noticed, at most.
const NOTICED: Duration = Duration::from_secs(10);

#[test]
#[ignore = "slow: a link cut of a minute"]
fn the_formation_rejoins_by_itself_after_a_cut_of_a_minute() {
    let what = "a link cut of a minute";
    let lan = match Lan::new(2) {
        Ok(lan) => lan,
        Err(why) => {
            skipped(what, &format!("network namespaces cannot be made here: {why}"));
            return;
        }
    };
    let mut formation = Formation::new(&PLATFORMS, &[LONG_HOLD])
        .in_namespaces(&lan.hosts[0], &[&lan.hosts[0], &lan.hosts[1]]);
    // One observer on each side, so that messages are observed without crossing the link.
    let network = Network { interfaces: None, ..formation.network(MONITOR) };
    let watches = [0, 1].map(|host| lan.on_host(host, || Watch::on(network.clone(), &PLATFORMS)));
    formation.start_all();
    formation.wait_for_step(&watches[0], "hold");
    let [here, there] = &watches;
    let status = route(1, Topic::ControlStatus);
    there.wait_next::<ControlStatus>("the follower to track", status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });

    lan.cut();
    let begin = Instant::now();
    let cut = whorl_ros::wall_clock();
    there.wait_next::<ControlStatus>("the follower to notice", status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_HOLD
    });
    let leader = route(0, Topic::ControlStatus);
    while begin.elapsed() < CUT {
        std::thread::sleep(Duration::from_millis(500));
        formation.check_alive();
    }
    let state = route(0, Topic::FormationState);
    let age = here.log().latest::<FormationState>(state).unwrap().1.link_age_s[1];
    assert!(age > CUT.as_secs_f64() - NOTICED.as_secs_f64(), "something crossed the cut: link age {age} s");
    here.wait_next::<ControlStatus>("the leader to be in control of itself", leader, STARTUP, |m| {
        matches!(m.mode, ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD)
    });

    lan.restore();
    let restored = whorl_ros::wall_clock();
    let seen = here.wait("the follower to be seen", STARTUP, |log| {
        log.after::<FormationState>(state, restored).find(|(_, m)| m.link_ok[1]).map(|(at, _)| at)
    });
    let tracks = there.wait("the follower to track", STARTUP, |log| {
        log.after::<ControlStatus>(status, restored)
            .find(|(_, m)| m.mode == ControlStatus::MODE_TRACK)
            .map(|(at, _)| at)
    });
    let (seen_s, tracks_s) = (seen.seconds_since(restored), tracks.seconds_since(restored));
    measured(&format!(
        "{what}: after {CUT:?} the follower is seen after {seen_s:.2} s and tracks after {tracks_s:.2} s"
    ));
    here.wait_next::<FormationState>("the sequence to go on", state, STARTUP, |m| m.step == "hold");
    what_neighbours_noticed(here, cut, restored);
    let renewed = ["/coordinator", "/whorl_1/estimator", "/whorl_2/estimator", "/whorl_2/local_control"]
        .into_iter()
        .any(|node| formation.node(node).log().contains("endpoints renewed"));
    assert!(renewed, "no side gave the other up in the cut: this test shows nothing");
    formation.stop();
}

/// The leader's estimates flow all the time, and its local control has what it needs: what of that is due to the cut, and what to
/// a busy machine, no number tells; so it is measured.
fn what_neighbours_noticed(here: &Watch, cut: Timestamp, restored: Timestamp) {
    let log = here.log();
    let (mut last, mut longest_s) = (cut, 0.0_f64);
    for (at, _) in log.after::<AttitudeEstimate>(route(0, Topic::AttitudeEstimate), cut) {
        longest_s = longest_s.max(at.seconds_since(last));
        last = at;
    }
    let modes: Vec<u8> = log
        .after::<ControlStatus>(route(0, Topic::ControlStatus), cut)
        .take_while(|(at, _)| *at < restored)
        .map(|(_, m)| m.mode)
        .collect();
    let safe = modes.iter().filter(|mode| **mode >= ControlStatus::MODE_SAFE_DAMPING).count();
    measured(&format!(
        "in the cut, of the leader: longest pause between estimates {longest_s:.2} s; {safe} of {} statuses are safe mode",
        modes.len()
    ));
}
