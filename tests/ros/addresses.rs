//! Fault row: a platform's computer gets another address (a new lease of DHCP, another access point). Its nodes join the
//! network anew, and the formation is whole again without a restart.
//!
//! Needs root and `ip` (iproute2) for two network namespaces.

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ControlStatus, FormationState};
use whorl_ros::environment::Network;
use whorl_security::policy::MONITOR;

use crate::support::formation::{Formation, LONG_HOLD, STARTUP};
use crate::support::network::Lan;
use crate::support::watch::{Watch, route};
use crate::support::{measured, skipped};

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];
#[test]
fn a_platform_whose_address_changes_returns_by_itself() {
    let what = "another address of a platform's computer";
    let lan = match Lan::new(2) {
        Ok(lan) => lan,
        Err(why) => {
            skipped(what, &format!("network namespaces cannot be made here: {why}"));
            return;
        }
    };
    let mut formation = Formation::new(&PLATFORMS, &[LONG_HOLD])
        .in_namespaces(&lan.hosts[0], &[&lan.hosts[0], &lan.hosts[1]]);
    let network = Network { interfaces: None, ..formation.network(MONITOR) };
    // On the other computer: its own address stays.
    let here = lan.on_host(0, || Watch::on(network, &PLATFORMS));
    formation.start_all();
    formation.wait_for_step(&here, "hold");
    let (state, status) = (route(0, Topic::FormationState), route(1, Topic::ControlStatus));
    here.wait_next::<ControlStatus>("the follower to track", status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });

    lan.readdress(1, 102).unwrap();
    let changed = whorl_ros::wall_clock();
    let lost = |m: &FormationState| !m.link_ok[1];
    here.wait_next::<FormationState>("the follower to be lost", state, STARTUP, lost);
    let seen = here.wait("the follower to be seen again", STARTUP, |log| {
        let mut after = log.after::<FormationState>(state, changed).skip_while(|(_, m)| m.link_ok[1]);
        after.find(|(_, m)| m.link_ok[1]).map(|(at, _)| at)
    });
    let tracks = here.wait("the follower to track again", STARTUP, |log| {
        let mut after = log.after::<ControlStatus>(status, seen);
        after.find(|(_, m)| m.mode == ControlStatus::MODE_TRACK).map(|(at, _)| at)
    });
    measured(&format!(
        "{what}: seen again after {:.2} s, tracks after {:.2} s",
        seen.seconds_since(changed),
        tracks.seconds_since(changed)
    ));
    for node in ["/whorl_2/driver", "/whorl_2/estimator", "/whorl_2/local_control"] {
        assert!(formation.node(node).log().contains("addresses of this computer have changed"), "{node}");
    }
    // Those whose address is the same were not disturbed.
    assert!(!formation.node("/whorl_1/local_control").log().contains("rejoined the network"));
    formation.stop();
}
