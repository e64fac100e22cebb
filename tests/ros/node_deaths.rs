//! Fault row: kill -9 of each node of a running formation. Each death has its response, each restart
//! its recovery; at the end Ctrl-C leaves nothing.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate, ControlStatus, FormationState};

use crate::support::formation::Formation;
use crate::support::measured;
use crate::support::watch::{Watch, route};

const SOON: Duration = Duration::from_secs(5);
const RECOVERY: Duration = Duration::from_secs(30);
/// The follower, whose nodes are killed; the leader continues.
const FOLLOWER: u16 = 1;

/// The follower tracks again, and the sequence goes on.
fn wait_for_recovery(watch: &Watch, after: &str) {
    let status = route(FOLLOWER, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>(&format!("tracking after {after}"), status, RECOVERY, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });
    let state = route(0, Topic::FormationState);
    watch.wait_next::<FormationState>(
        &format!("the sequence to go on after {after}"),
        state,
        RECOVERY,
        |m| m.step == "hold" && m.link_ok.iter().all(|ok| *ok),
    );
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
    let killed = formation.kill("/whorl_2/estimator");
    let safe = watch.wait_next::<ControlStatus>("safe mode without estimates", status, SOON, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING && m.reason == ControlStatus::REASON_ESTIMATE_STALE
    });
    assert!(safe.seconds_since(killed) < 0.5, "safe after {} s", safe.seconds_since(killed));
    watch.wait_next::<ControlStatus>("coasting", status, Duration::from_secs(10), |m| {
        m.mode == ControlStatus::MODE_SAFE_COAST
    });
    watch.wait_next::<FormationState>("the sequence to wait", state, SOON, |m| m.step.contains("(waiting)"));
    let leader = route(0, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>("the leader to stay in control", leader, SOON, |m| {
        m.mode <= ControlStatus::MODE_HOLD && m.mode != ControlStatus::MODE_IDLE
    });
    formation.start("/whorl_2/estimator");
    wait_for_recovery(&watch, "the estimator's death");

    // Driver: nothing is measured, so the estimate is stale or unusable and control is safe.
    formation.kill("/whorl_2/driver");
    watch.wait_next::<ControlStatus>("safe mode without a driver", status, SOON, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING
    });
    watch.wait_next::<AttitudeEstimate>("the estimator to say so", estimate, SOON, |m| {
        m.flags & AttitudeEstimate::FLAG_IMU_STALE != 0 || !m.usable()
    });
    formation.start("/whorl_2/driver");
    wait_for_recovery(&watch, "the driver's death");

    // Coordinator: without its heartbeat no node has authority; the platforms come to rest and let go.
    let killed = formation.kill("/coordinator");
    for platform in 0..2 {
        let status = route(platform, Topic::ControlStatus);
        let held = watch.wait_next::<ControlStatus>("a hold without authority", status, SOON, |m| {
            m.reason == ControlStatus::REASON_NO_AUTHORITY
        });
        assert!(held.seconds_since(killed) < 1.0, "{} s", held.seconds_since(killed));
        watch.wait_next::<ControlStatus>("letting go", status, Duration::from_secs(25), |m| {
            m.mode == ControlStatus::MODE_IDLE
        });
        let command = route(platform, Topic::ActuatorCommand);
        watch.wait_next::<ActuatorCommand>("commands of nothing", command, SOON, |m| {
            m.wheel_torque_n_m.iter().chain(&m.jet_on_time_s).all(|x| *x == 0.0)
        });
    }
    formation.start("/coordinator");
    wait_for_recovery(&watch, "the coordinator's death");

    formation.stop();
}
