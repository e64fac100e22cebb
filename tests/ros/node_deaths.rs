//! Fault row: kill -9 of each node of a running formation. Each death has its response, each restart
//! its recovery; at the end Ctrl-C leaves nothing. How soon a core responds is asserted in virtual time
//! (`nodes/local_control/src/tests/responses.rs`).

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, AttitudeEstimate, ControlStatus, FormationCommand, FormationState};
use whorl_node::Timestamp;
use whorl_ros::wall_clock;

use crate::support::formation::{Formation, LONG_HOLD, STARTUP};
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
    let mut formation = Formation::new(&["whorl_1", "whorl_2"], &[LONG_HOLD]);
    // As `whorl run` has it: a coordinator that is started again goes on.
    let progress = formation.folder().join("coordinator.progress");
    formation.set_environment_of_all(vec![("WHORL_PROGRESS_FILE".into(), progress.display().to_string())]);
    let (mut formation, watch) = formation.held();
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
    // Long enough in the hold that a new beginning would be seen.
    watch.wait_next::<FormationState>("ten seconds of the hold", state, STARTUP, |m| m.step_elapsed_s > 10.0);
    formation.kill("/coordinator");
    let died = wall_clock();
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
    // It never was in its first step again, and the time without it counts as waiting.
    let log = watch.log();
    let states = log.after::<FormationState>(state, died);
    let running: Vec<_> =
        states.map(|(_, m)| m).filter(|m| m.phase >= FormationState::PHASE_SETTLE).collect();
    assert!(running.iter().all(|m| m.step.starts_with("hold") && m.step_elapsed_s > 9.0), "{:?}", running[0]);
    drop(log);

    // What is too old moves nothing, however often it is started.
    formation.kill("/coordinator");
    let text = std::fs::read_to_string(&progress).unwrap();
    let (stamp, kept) = text.split_once('\n').unwrap();
    let words: Vec<&str> = stamp.split(' ').collect();
    let [boot, monotonic_s, wall_s] = words[..] else { panic!("{stamp}") };
    let earlier = |seconds: &str| seconds.parse::<f64>().unwrap() - 400.0;
    let old = format!("{boot} {} {}\n{kept}", earlier(monotonic_s), earlier(wall_s));
    std::fs::write(&progress, old).unwrap();
    let stale = wall_clock();
    formation.start("/coordinator");
    watch.wait_next::<FormationState>("an end in place of a motion", state, STARTUP, |m| {
        m.phase == FormationState::PHASE_ABORTED && m.step.contains("without a coordinator")
    });
    let log = watch.log();
    let commands = log.after::<FormationCommand>(route(0, Topic::FormationCommand), stale);
    // The last of the killed one may still be on its way.
    let own: Vec<_> = commands.filter(|(_, m)| Timestamp::from(m.header.stamp) > stale).collect();
    assert!(!own.is_empty());
    assert_eq!(own.iter().filter(|(_, m)| m.command != FormationCommand::COMMAND_STANDBY).count(), 0);
    drop(log);
    // Without anything kept, as `whorl run` starts: from the beginning.
    formation.kill("/coordinator");
    std::fs::remove_file(&progress).unwrap();
    formation.start("/coordinator");
    wait_for_recovery(&watch, "a new beginning");

    formation.stop();
}
