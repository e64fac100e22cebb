//! Fault row: a jet fails. Control goes on with that jet at zero.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus, ThrusterState};
use whorl_params::Value;

use super::held::{Held, NEVER_S, SOON, error_deg};
use crate::support::measured;
use crate::support::watch::route;

pub fn is_left_out_by_the_allocation(held: &mut Held) {
    held.set_control("actuators", &Value::String("jets".to_owned()));
    let thrusters = route(0, Topic::ThrusterState);
    let commands = route(0, Topic::ActuatorCommand);
    held.watch
        .wait_next::<ActuatorCommand>("jet 2 to be needed", commands, SOON, |m| m.jet_on_time_s[1] > 0.0);
    held.wait_until_it_points(0.3);
    let set = whorl_ros::wall_clock();
    held.set_driver("faults.jet.start_s", &Value::Double(0.0));
    let watch = &held.watch;
    let failed = watch.wait("the failure", SOON, |log| {
        log.after::<ThrusterState>(thrusters, set)
            .find(|(_, m)| m.health[1] == ThrusterState::HEALTH_FAILED)
            .map(|(at, _)| at)
    });
    let status = route(0, Topic::ControlStatus);
    let known = watch.wait("control to know", Duration::from_secs(5), |log| {
        log.after::<ControlStatus>(status, set).find(|(_, m)| m.jet_failed[1]).map(|(at, _)| at)
    });
    assert!(known.seconds_since(failed) < 0.5, "{} s", known.seconds_since(failed));
    watch.during(Duration::from_secs(5));

    let log = watch.log();
    let others =
        log.after::<ActuatorCommand>(commands, known).filter(|(_, m)| m.jet_on_time_s[6] > 0.0).count();
    assert!(others > 0, "jet 7 does not take its place");
    // Commands repeat the pulses of their slot of 0.1 s, which was planned before.
    for (_, command) in log.after::<ActuatorCommand>(commands, known + Duration::from_millis(200)) {
        assert_eq!(command.jet_on_time_s[1], 0.0, "the failed jet is still commanded");
    }
    let mut worst_deg = 0.0_f64;
    for (_, m) in log.after::<ControlStatus>(status, known) {
        assert_eq!(m.mode, ControlStatus::MODE_TRACK, "reason {}", m.reason);
        worst_deg = worst_deg.max(error_deg(m));
    }
    measured(&format!("with a lost jet Whorl-I stays within {worst_deg:.3} deg of its reference"));
    assert!(worst_deg < 0.2, "{worst_deg} deg");
    drop(log);
    held.set_driver("faults.jet.start_s", &Value::Double(NEVER_S));
    held.set_control("actuators", &Value::String("both".to_owned()));
}
