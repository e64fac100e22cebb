//! Fault row: the link between two computers is cut for a minute. Both sides rejoin without a restart.

use std::time::{Duration, Instant};

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ControlStatus, FormationState};
use whorl_ros::environment::Network;

use crate::support::formation::{Formation, LONG_HOLD};
use crate::support::network::Lan;
use crate::support::watch::{Watch, route};
use crate::support::{fast_only, measured, skipped};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];
/// Longer than DDS's lease of 50 s: the other side is given up in it.
const CUT: Duration = Duration::from_secs(65);
const REJOIN: Duration = Duration::from_secs(2);

#[test]
fn the_formation_rejoins_within_two_seconds_after_a_cut_of_a_minute() {
    let what = "a link cut of a minute";
    if fast_only() {
        skipped(what, "WHORL_FAST_TESTS=1");
        return;
    }
    let lan = match Lan::new() {
        Ok(lan) => lan,
        Err(why) => {
            skipped(what, &format!("network namespaces cannot be made here: {why}"));
            return;
        }
    };
    let mut formation =
        Formation::new(&PLATFORMS, &[LONG_HOLD]).in_namespaces(&[&lan.hosts[0], &lan.hosts[1]]);
    // One observer on each side: what crosses the link must not be judged by who sits beyond it.
    let network = Network { domain_id: formation.domain(), interfaces: None, static_peers: Vec::new() };
    let watches = [0, 1].map(|host| lan.on_host(host, || Watch::on(network.clone(), &PLATFORMS)));
    formation.start_all();
    formation.wait_for_step(&watches[0], "hold");
    let [here, there] = &watches;
    let status = route(1, Topic::ControlStatus);
    there.wait_next::<ControlStatus>("the follower to track", status, REJOIN, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });

    lan.cut();
    let begin = Instant::now();
    there.wait_next::<ControlStatus>("the follower to notice", status, Duration::from_secs(2), |m| {
        m.mode == ControlStatus::MODE_HOLD
    });
    let leader = route(0, Topic::ControlStatus);
    while begin.elapsed() < CUT {
        std::thread::sleep(Duration::from_millis(500));
        formation.check_alive();
    }
    let state = route(0, Topic::FormationState);
    let age = here.log().latest::<FormationState>(state).unwrap().1.link_age_s[1];
    assert!(age > CUT.as_secs_f64() - 2.0, "something crossed the cut: link age {age} s");
    here.wait_next::<ControlStatus>("the leader to be in control of itself", leader, REJOIN, |m| {
        matches!(m.mode, ControlStatus::MODE_TRACK | ControlStatus::MODE_HOLD)
    });

    lan.restore();
    let restored = whorl_ros::wall_clock();
    let seen = here.wait("the follower to be seen", REJOIN * 4, |log| {
        log.after::<FormationState>(state, restored).find(|(_, m)| m.link_ok[1]).map(|(at, _)| at)
    });
    let tracks = there.wait("the follower to track", REJOIN * 4, |log| {
        log.after::<ControlStatus>(status, restored)
            .find(|(_, m)| m.mode == ControlStatus::MODE_TRACK)
            .map(|(at, _)| at)
    });
    let (seen_s, tracks_s) = (seen.seconds_since(restored), tracks.seconds_since(restored));
    measured(&format!(
        "after a cut of {CUT:?} the follower is seen after {seen_s:.2} s and tracks after {tracks_s:.2} s"
    ));
    assert!(seen_s < REJOIN.as_secs_f64(), "seen after {seen_s} s");
    assert!(tracks_s < REJOIN.as_secs_f64(), "tracks after {tracks_s} s");
    here.wait_next::<FormationState>("the sequence to go on", state, Duration::from_secs(20), |m| {
        m.step == "hold"
    });
    formation.stop();
}
