//! Fault row: commands stop arriving. The driver closes all valves and sets wheel torque to zero, in its own process. Within
//! which time is asserted of its core, in virtual time (`nodes/driver/src/core/tests.rs`, `gate/tests.rs`).

use std::time::Duration;

use rustix::process::Signal;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus, GateState, ThrusterState};
use whorl_node::Timestamp;
use whorl_ros::EndpointQos;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::simulation::encoded;
use crate::support::wait_for;
use crate::support::watch::{Log, Watch, route};

/// Waits until the driver says that everything is off, and then for measurements of that: closed valves, motors without
/// torque.
fn wait_until_off(watch: &Watch) {
    let gate = route(0, Topic::GateState);
    watch.wait_next::<GateState>("the gate to close", gate, STARTUP, |m| m.state == GateState::STATE_OFF);
    let since = whorl_ros::wall_clock();
    let is_later = |stamp: Timestamp| stamp > since;
    watch.wait_next::<ThrusterState>("closed valves", route(0, Topic::ThrusterState), STARTUP, |m| {
        is_later(m.header.stamp.into())
            && !m.valve_open.contains(&true)
            && m.on_time_s.iter().all(|t| *t == 0.0)
    });
    watch.wait_next::<JointState>("wheels without torque", route(0, Topic::WheelState), STARTUP, |m| {
        is_later(m.header.stamp.into()) && m.effort.iter().all(|torque| *torque == 0.0)
    });
}

#[test]
fn a_driver_alone_obeys_a_sender_and_switches_off_when_he_falls_silent() {
    let mut formation = Formation::new(&["whorl_1"], &[LONG_HOLD_ALONE]);
    let watch = formation.watch();
    formation.start("/whorl_1/driver");
    let participant = formation.participant();
    let info = Topic::ActuatorCommand.info();
    let name = route(0, Topic::ActuatorCommand).name(&["whorl_1"]).unwrap();
    let writer = participant.writer(&name, info.message_type.name(), EndpointQos::from(info.qos)).unwrap();
    watch
        .wait("the driver", STARTUP, |log| log.latest::<JointState>(route(0, Topic::WheelState)).map(|_| ()));

    // One pulse of a minute, in commands that claim to be valid for an hour.
    let mut sequence = 0;
    let obeyed = |log: &Log| {
        let torque = |(_, m): (_, &JointState)| m.effort[0] > 0.09;
        let opened = |(_, m): (_, &ThrusterState)| m.valve_open[2];
        log.latest(route(0, Topic::WheelState)).is_some_and(torque)
            && log.latest(route(0, Topic::ThrusterState)).is_some_and(opened)
    };
    wait_for("the driver to obey", STARTUP, || {
        let now = whorl_ros::wall_clock();
        let mut jets = vec![0.0; 12];
        jets[2] = 60.0;
        let command = ActuatorCommand {
            header: Header { stamp: now.into(), frame_id: String::new() },
            sequence,
            valid_until: (now + Duration::from_secs(3600)).into(),
            wheel_torque_n_m: vec![0.1, 0.0, -0.1],
            jet_slot: 0,
            jet_slot_length_s: 60.0,
            jet_on_time_s: jets,
            gimbal_rate_rad_s: Vec::new(),
        };
        writer.publish(&encoded(&command.into())).unwrap();
        sequence += 1;
        obeyed(&watch.log()).then_some(())
    });
    wait_until_off(&watch);
}

#[test]
fn actuators_go_off_when_local_control_is_killed_or_stopped_and_it_tracks_again_afterwards() {
    let jets = "/**/local_control: {ros__parameters: {actuators: both}}";
    let (mut formation, watch) = Formation::holding_alone(&[jets]);
    formation.kill("/whorl_1/local_control");
    wait_until_off(&watch);
    formation.start("/whorl_1/local_control");
    let tracks = |m: &ControlStatus| m.mode == ControlStatus::MODE_TRACK;
    watch.wait_next("tracking after the restart", route(0, Topic::ControlStatus), STARTUP, tracks);

    // Alive, but not sending.
    formation.node("/whorl_1/local_control").signal(Signal::STOP);
    wait_until_off(&watch);
    formation.node("/whorl_1/local_control").signal(Signal::CONT);
    watch.wait_next("tracking after the pause", route(0, Topic::ControlStatus), STARTUP, tracks);
    formation.stop();
}
