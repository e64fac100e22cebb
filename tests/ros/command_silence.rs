//! Fault row: commands stop arriving. The driver closes all valves and sets wheel torque to zero within 100 ms,
//! in its own process.

use std::time::Duration;

use rustix::process::Signal;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus, ThrusterState};
use whorl_node::Timestamp;
use whorl_ros::EndpointQos;

use crate::support::formation::{Formation, LONG_HOLD_ALONE, STARTUP};
use crate::support::simulation::encoded;
use crate::support::watch::{Log, Watch, route};

const WITHIN: Duration = Duration::from_millis(100);
const TRACKING: Duration = Duration::from_secs(20);

/// Fails unless all valves are closed and all motors off from `silent + 100 ms` on; returns how many
/// states of each say so.
fn assert_off_after(log: &Log, platform: u16, silent: Timestamp) -> (usize, usize) {
    let off = silent + WITHIN;
    let thrusters: Vec<&ThrusterState> = log
        .after::<ThrusterState>(route(platform, Topic::ThrusterState), silent)
        .map(|(_, m)| m)
        .filter(|m| Timestamp::from(m.header.stamp) > off)
        .collect();
    for state in &thrusters {
        let late = Timestamp::from(state.header.stamp).seconds_since(silent);
        assert!(!state.valve_open.contains(&true), "a valve is open {late} s after the last command");
    }
    // The first interval may hold time from before the limit.
    for state in thrusters.iter().skip(1) {
        assert!(state.on_time_s.iter().all(|t| *t == 0.0), "a jet fired: {:?}", state.on_time_s);
    }
    let wheels: Vec<&JointState> = log
        .after::<JointState>(route(platform, Topic::WheelState), silent)
        .map(|(_, m)| m)
        .filter(|m| Timestamp::from(m.header.stamp) > off)
        .collect();
    for state in &wheels {
        let late = Timestamp::from(state.header.stamp).seconds_since(silent);
        assert!(
            state.effort.iter().all(|u| *u == 0.0),
            "{:?} N m, {late} s after the last command",
            state.effort
        );
    }
    (thrusters.len(), wheels.len())
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

    // One pulse of 20 s, in commands that claim to be valid for an hour.
    let mut last = whorl_ros::wall_clock();
    let mut sequence = 0;
    let obeyed = |log: &Log| {
        log.latest::<JointState>(route(0, Topic::WheelState)).is_some_and(|(_, m)| m.effort[0] > 0.09)
    };
    while sequence < 25 || !obeyed(&watch.log()) {
        assert!(sequence < 500, "the driver does not obey\n{}", formation.node("/whorl_1/driver").log());
        last = whorl_ros::wall_clock();
        let mut jets = vec![0.0; 12];
        jets[2] = 20.0;
        let command = ActuatorCommand {
            header: Header { stamp: last.into(), frame_id: String::new() },
            sequence,
            valid_until: (last + Duration::from_secs(3600)).into(),
            wheel_torque_n_m: vec![0.1, 0.0, -0.1],
            jet_slot: 0,
            jet_slot_length_s: 20.0,
            jet_on_time_s: jets,
            gimbal_rate_rad_s: Vec::new(),
        };
        writer.publish(&encoded(&command.into())).unwrap();
        sequence += 1;
        std::thread::sleep(Duration::from_millis(20));
    }
    watch.during(Duration::from_secs(1));
    let log = watch.log();
    let open_before = log
        .of::<ThrusterState>(route(0, Topic::ThrusterState))
        .any(|(_, m)| m.valve_open[2] && Timestamp::from(m.header.stamp) <= last);
    assert!(open_before, "the valve never opened");
    let (thrusters, wheels) = assert_off_after(&log, 0, last);
    assert!(thrusters > 50 && wheels > 50, "{thrusters}, {wheels} states");
}

#[test]
fn actuators_go_off_when_local_control_is_killed_or_stopped_and_it_tracks_again_afterwards() {
    let jets = "/**/local_control: {ros__parameters: {actuators: both}}";
    let (mut formation, watch) = Formation::holding_alone(&[jets]);
    let commands = route(0, Topic::ActuatorCommand);
    let last_command = |watch: &Watch| watch.log().latest::<ActuatorCommand>(commands).unwrap().0;

    formation.kill("/whorl_1/local_control");
    watch.during(Duration::from_secs(1));
    let last = last_command(&watch);
    let (thrusters, wheels) = assert_off_after(&watch.log(), 0, last);
    assert!(thrusters > 50 && wheels > 50, "{thrusters}, {wheels} states");
    formation.start("/whorl_1/local_control");
    let tracks = |m: &ControlStatus| m.mode == ControlStatus::MODE_TRACK;
    watch.wait_next("tracking after the restart", route(0, Topic::ControlStatus), TRACKING, tracks);

    // Alive, but not sending.
    formation.node("/whorl_1/local_control").signal(Signal::STOP);
    watch.during(Duration::from_secs(1));
    let last = last_command(&watch);
    assert_off_after(&watch.log(), 0, last);
    formation.node("/whorl_1/local_control").signal(Signal::CONT);
    watch.wait_next("tracking after the pause", route(0, Topic::ControlStatus), TRACKING, tracks);
    formation.stop();
}
