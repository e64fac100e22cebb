//! A recording replaces the hardware: the estimator runs on it as on real hardware.

use std::process::Command;

use whorl_math::attitude_error;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::AttitudeEstimate;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::watch::route;
use crate::support::{binaries, root};

#[test]
fn a_replayed_run_feeds_the_estimator_and_ends() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let run = formation.folder().join("recorded");
    let output = Command::new(binaries::path("whorl"))
        .args(["simulate", "--no-report", "--longest", "12", "--experiment"])
        .arg(root().join("params/experiments/leader_follower_short.yaml"))
        .arg("--out")
        .arg(&run)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));

    let watch = formation.watch();
    formation.start("/whorl_1/estimator");
    let source = format!("replay.source:={}", run.display());
    formation.start_with("/whorl_1/driver", &["backend:=replay".to_owned(), source]);
    watch.wait("an estimate", STARTUP, |log| {
        log.of::<AttitudeEstimate>(route(0, Topic::AttitudeEstimate)).find(|(_, m)| m.usable()).map(|_| ())
    });
    // In real time, and then it is over.
    let status = formation.node("/whorl_1/driver").wait(STARTUP);
    assert!(status.success(), "{status}; {}", formation.node("/whorl_1/driver").log());

    let log = watch.log();
    let truth: std::collections::BTreeMap<(i32, u32), _> = log
        .of::<AttitudeEstimate>(route(0, Topic::TruthState))
        .map(|(_, m)| ((m.header.stamp.sec, m.header.stamp.nanosec), m.q_world_body.to_unit().unwrap()))
        .collect();
    let errors: Vec<f64> = log
        .of::<AttitudeEstimate>(route(0, Topic::AttitudeEstimate))
        .filter(|(_, m)| m.usable())
        .filter_map(|(_, m)| {
            let q = truth.get(&(m.header.stamp.sec, m.header.stamp.nanosec))?;
            Some(attitude_error(q, &m.q_world_body.to_unit()?).norm().to_degrees())
        })
        .collect();
    // How well it estimates is asserted where no sample can be late (`tests/replay`, `whorl_estimation`).
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(best < 0.2, "{best} deg in {} estimates with a truth", errors.len());
}
