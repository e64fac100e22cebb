//! Fault row: kill -9 of each node of a running formation. Each death has its response, each restart
//! its recovery; at the end Ctrl-C leaves nothing. How soon a core responds is asserted in virtual time
//! (`nodes/local_control/src/tests/responses.rs`).

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate, ControlStatus, FormationState};

use crate::support::formation::{Formation, STARTUP};
use crate::support::measured;
use crate::support::watch::{Watch, route};

/// The follower, whose nodes are killed; the leader continues.
const FOLLOWER: u16 = 1;

/// The follower tracks again, and the sequence goes on.
fn wait_for_recovery(watch: &Watch, after: &str) {
    let status = route(FOLLOWER, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>(&format!("tracking after {after}"), status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });
    let state = route(0, Topic::FormationState);
    watch.wait_next::<FormationState>(&format!("the sequence to go on after {after}"), state, STARTUP, |m| {
        m.step == "hold" && m.link_ok.iter().all(|ok| *ok)
    });
}

#[test]
fn each_node_may_die_and_come_back() {
    let (mut formation, watch) = Formation::holding(&[]);
    let status = route(FOLLOWER, Topic::ControlStatus);
    let estimate = route(FOLLOWER, Topic::AttitudeEstimate);
    let state = route(0, Topic::FormationState);

    let (cores, bytes) = formation.load(Duration::from_secs(3));
    measured(&format!("7 processes: {cores:.2} cores together, at most {:.1} MB each", bytes as f64 / 1e6));

    // Estimator: local control damps on the gyro, then coasts.
    formation.kill("/whorl_2/estimator");
    watch.wait_next::<ControlStatus>("safe mode without estimates", status, STARTUP, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING && m.reason == ControlStatus::REASON_ESTIMATE_STALE
    });
    watch.wait_next::<ControlStatus>("coasting", status, STARTUP, |m| {
        m.mode == ControlStatus::MODE_SAFE_COAST
    });
    watch.wait_next::<FormationState>("the sequence to wait", state, STARTUP, |m| {
        m.step.contains("(waiting)")
    });
    let leader = route(0, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>("the leader to stay in control", leader, STARTUP, |m| {
        m.mode <= ControlStatus::MODE_HOLD && m.mode != ControlStatus::MODE_IDLE
    });
    formation.start("/whorl_2/estimator");
    wait_for_recovery(&watch, "the estimator's death");

    // Driver: nothing is measured, so the estimate is stale or unusable and control is safe.
    formation.kill("/whorl_2/driver");
    watch.wait_next::<ControlStatus>("safe mode without a driver", status, STARTUP, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING
    });
    watch.wait_next::<AttitudeEstimate>("the estimator to say so", estimate, STARTUP, |m| {
        m.flags & AttitudeEstimate::FLAG_IMU_STALE != 0 || !m.usable()
    });
    formation.start("/whorl_2/driver");
    wait_for_recovery(&watch, "the driver's death");

    // Coordinator: without its heartbeat no node has authority; the platforms come to rest and let go.
    formation.kill("/coordinator");
    for platform in 0..2 {
        let status = route(platform, Topic::ControlStatus);
        watch.wait_next::<ControlStatus>("a hold without authority", status, STARTUP, |m| {
            m.reason == ControlStatus::REASON_NO_AUTHORITY
        });
        watch.wait_next::<ControlStatus>("letting go", status, STARTUP, |m| {
            m.mode == ControlStatus::MODE_IDLE
        });
        let command = route(platform, Topic::ActuatorCommand);
        watch.wait_next::<ActuatorCommand>("commands of nothing", command, STARTUP, |m| {
            m.wheel_torque_n_m.iter().chain(&m.jet_on_time_s).all(|x| *x == 0.0)
        });
    }
    formation.start("/coordinator");
    wait_for_recovery(&watch, "the coordinator's death");

    formation.stop();
}
