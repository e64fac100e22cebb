//! Fault row: the leader's state goes stale. The follower decelerates, stands still, and rejoins by itself.

use nalgebra::Vector3;
use rustix::process::Signal;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ControlStatus, FormationState};

use crate::support::formation::{Formation, STARTUP};
use crate::support::watch::{Watch, route};

/// The leader turns at 0.5 deg/s for longer than the test lasts, also on a busy machine.
const TURNING: &str = r#"
/coordinator:
  ros__parameters:
    experiment: {name: turning}
    law:
      kind: leader_follower
      members:
        whorl_2: {leader: whorl_1, offset: {yaw_deg: 20.0}}
    steps:
      settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
      turn: {kind: slew, duration_s: 200.0, yaw_deg: 90.0, rate_max_deg_s: 0.5}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
/whorl_2/driver:
  ros__parameters:
    initial: {yaw_deg: 19.0, pitch_deg: -0.5, roll_deg: 1.0}
"#;

fn rate_deg_s(v: whorl_msgs::geometry_msgs::Vector3) -> f64 {
    Vector3::from(v).norm().to_degrees()
}

/// Waits until the follower's reference turns with the leader.
fn wait_for_turning(watch: &Watch) {
    let reference = route(1, Topic::AttitudeReference);
    watch.wait_next::<AttitudeReference>("the follower's reference to turn", reference, STARTUP, |m| {
        m.mode == AttitudeReference::MODE_TRACK && rate_deg_s(m.omega_wr_r_rad_s) > 0.4
    });
}

#[test]
fn the_follower_stops_while_the_leader_is_not_seen_and_rejoins_when_it_is() {
    let mut formation = Formation::new(&["whorl_1", "whorl_2"], &[TURNING]);
    let watch = formation.watch();
    formation.start_all();
    formation.wait_for_step(&watch, "turn");
    wait_for_turning(&watch);

    formation.node("/whorl_1/estimator").signal(Signal::STOP);
    let reference = route(1, Topic::AttitudeReference);
    watch.wait_next::<AttitudeReference>("the follower's reference to be held", reference, STARTUP, |m| {
        m.mode == AttitudeReference::MODE_HOLD
    });
    watch.wait_next::<AttitudeReference>(
        "the follower's reference to stand still",
        reference,
        STARTUP,
        |m| rate_deg_s(m.omega_wr_r_rad_s) < 1e-3,
    );
    watch.wait_next::<AttitudeEstimate>(
        "the follower itself to stand still",
        route(1, Topic::TruthState),
        STARTUP,
        |m| rate_deg_s(m.omega_wb_b_rad_s) < 0.1,
    );
    // Its control stays active.
    watch.wait_next::<ControlStatus>("a hold", route(1, Topic::ControlStatus), STARTUP, |m| {
        m.mode == ControlStatus::MODE_HOLD
    });

    formation.node("/whorl_1/estimator").signal(Signal::CONT);
    wait_for_turning(&watch);
    watch.wait_next::<FormationState>(
        "a small relative error",
        route(0, Topic::FormationState),
        STARTUP,
        |m| m.link_ok[0] && rate_deg_s(m.relative_error_rad[1]) < 0.5,
    );
    formation.stop();
}
