//! Fault row: a jet fails. Control goes on with that jet at zero; how well is asserted in virtual time (`closed_loop::faults`).

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus, ThrusterState};
use whorl_params::Value;

use super::held::{Held, NEVER_S, SOON};
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
    watch.wait("the failure", SOON, |log| {
        log.after::<ThrusterState>(thrusters, set)
            .find(|(_, m)| m.health[1] == ThrusterState::HEALTH_FAILED)
            .map(|(at, _)| at)
    });
    let status = route(0, Topic::ControlStatus);
    let known = watch.wait("control to know", SOON, |log| {
        log.after::<ControlStatus>(status, set).find(|(_, m)| m.jet_failed[1]).map(|(at, _)| at)
    });
    watch.wait("jet 7 to take its place", SOON, |log| {
        let mut later = log.after::<ActuatorCommand>(commands, known);
        later.find(|(_, m)| m.jet_on_time_s[6] > 0.0 && m.jet_on_time_s[1] == 0.0).map(|_| ())
    });
    held.set_driver("faults.jet.start_s", &Value::Double(NEVER_S));
    held.set_control("actuators", &Value::String("both".to_owned()));
}
