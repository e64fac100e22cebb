//! Bad messages are dropped and counted, and change nothing.

use std::sync::Arc;

use super::rig::*;
use nalgebra::{UnitQuaternion, Vector3};
use whorl_control::Reference;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::{Message, PlatformId, Route, Topic};
use whorl_msgs::whorl::ControlStatus;
use whorl_node::{Configurable, Event, NodeCore, Outputs, Timestamp};
use whorl_params::try_read;

fn own(topic: Topic) -> Route {
    Route::platform(PlatformId(0), topic)
}

fn tracking() -> Rig {
    let mut rig = Rig::holding("whorl_1", &["actuators:=wheels"], balanced());
    rig.run(2.0);
    rig
}

/// The counts in the node's diagnostics.
fn count(rig: &mut Rig, key: &str) -> u64 {
    rig.now = Timestamp(rig.now.0 + 2_000_000_000);
    let mut outputs = Outputs::default();
    rig.core.step(rig.now, Event::Timer, &mut outputs);
    let array = outputs.messages.into_iter().find_map(|p| match Arc::unwrap_or_clone(p.message) {
        Message::DiagnosticArray(array) => Some(array),
        _ => None,
    });
    let values = array.unwrap().status.remove(0).values;
    values.into_iter().find(|v| v.key == key).unwrap().value.parse().unwrap()
}

#[test]
fn estimates_that_are_not_finite_double_or_old_trigger_nothing() {
    let mut rig = tracking();
    let commands = rig.commands.len();
    let good = rig.estimate();
    rig.now = Timestamp(rig.now.0 + PERIOD_NS);
    let mut nan = rig.estimate();
    nan.omega_wb_b_rad_s.y = f64::NAN;
    let mut no_rotation = rig.estimate();
    no_rotation.q_world_body.w = 3.0;
    let mut old = rig.estimate();
    old.header.stamp = Timestamp(rig.now.0 - 5 * PERIOD_NS).into();
    for bad in [nan, no_rotation, old, good] {
        rig.send(own(Topic::AttitudeEstimate), bad);
    }
    assert_eq!(rig.commands.len(), commands);
    assert_eq!(count(&mut rig, "messages not finite"), 2);
    assert_eq!(count(&mut rig, "messages out of order"), 2);
}

#[test]
fn late_messages_are_counted_as_late() {
    let mut rig = tracking();
    let mut late = rig.estimate();
    late.header.stamp = Timestamp(rig.now.0).into();
    rig.now = Timestamp(rig.now.0 + 1_500_000_000);
    rig.send(own(Topic::AttitudeEstimate), late);
    assert_eq!(count(&mut rig, "messages late"), 1);
}

#[test]
fn bad_references_and_wheel_speeds_change_nothing() {
    let mut rig = tracking();
    let reference = Reference::at_rest(UnitQuaternion::from_euler_angles(0.0, 0.0, 1.0));
    rig.now = Timestamp(rig.now.0 + 1_000_000);
    let mut bad = rig.reference_message(&reference);
    bad.omega_wr_r_rad_s.x = f64::INFINITY;
    rig.send(own(Topic::AttitudeReference), bad);
    let header = Header { stamp: rig.now.into(), frame_id: String::new() };
    let two = JointState { header: header.clone(), velocity: vec![1.0; 2], ..JointState::default() };
    let nan = JointState { header, velocity: vec![f64::NAN; 3], ..JointState::default() };
    rig.send(own(Topic::WheelState), two);
    rig.send(own(Topic::WheelState), nan);
    rig.run(5.0);
    assert!(deg(rig.plant.truth().q_world_body.angle_to(&balanced())) < 0.05);
    assert_eq!(count(&mut rig, "messages not finite"), 2);
    assert_eq!(count(&mut rig, "messages of wrong size"), 1);
}

#[test]
fn a_restarted_sender_is_believed() {
    let mut rig = tracking();
    rig.now = Timestamp(rig.now.0 + PERIOD_NS);
    let commands = rig.commands.len();
    let mut restarted = rig.estimate();
    restarted.sequence = 0;
    rig.send(own(Topic::AttitudeEstimate), restarted);
    assert_eq!(rig.commands.len(), commands + 1);
}

#[test]
fn commands_are_valid_for_less_than_the_drivers_patience_and_stamped_in_order() {
    let mut rig = tracking();
    rig.estimator_on = false;
    rig.run(1.0);
    rig.estimator_on = true;
    rig.run(2.0);
    for pair in rig.commands.windows(2) {
        assert!(Timestamp::from(pair[1].header.stamp) >= Timestamp::from(pair[0].header.stamp));
        assert_eq!(pair[1].sequence, pair[0].sequence + 1);
    }
    let command = rig.command();
    let valid_s = Timestamp::from(command.valid_until).seconds_since(rig.now);
    assert!((valid_s - 0.06).abs() < 1e-9, "{valid_s}");
    assert_eq!(command.header.frame_id, "whorl_1/base_link");
}

#[test]
fn rates_are_those_of_the_parameters() {
    let mut rig = Rig::holding("whorl_1", &["control_rate_hz:=50.0", "status_rate_hz:=20.0"], balanced());
    rig.run(2.0);
    let (commands, statuses) = (rig.commands.len(), rig.statuses.len());
    rig.run(10.0);
    assert_eq!(rig.commands.len() - commands, 500);
    assert_eq!(rig.statuses.len() - statuses, 200);
}

#[test]
fn gains_can_change_while_it_runs_and_nothing_jumps() {
    let q = UnitQuaternion::from_euler_angles(0.0, 0.03, 0.3);
    let mut rig = Rig::holding("whorl_1", &["actuators:=wheels"], q);
    rig.run(40.0);
    let before = rig.command().wheel_torque_n_m.clone();
    rig.core
        .reconfigure(&parameters("whorl_1", &["actuators:=wheels", "tracking.damping:=[1.1, 1.1, 1.1]"]))
        .unwrap();
    rig.run(0.02);
    let after = &rig.command().wheel_torque_n_m;
    assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 2e-3), "{before:?} {after:?}");
    assert_eq!(rig.mode().0, ControlStatus::MODE_TRACK);
    let other = parameters("whorl_2", &[]);
    assert!(rig.core.reconfigure(&other).is_err());
    assert_eq!(rig.core.parameters().name, "whorl_1");
}

#[test]
fn wrong_parameters_are_refused_with_their_reason() {
    let refused = |arguments: &[&str]| {
        let node = tree(arguments).for_node("/whorl_1/local_control");
        try_read(&node, crate::parameters::read).map(|_| ()).unwrap_err().to_string()
    };
    assert!(refused(&["tracking.integral_time_s:=0.2"]).contains("integral time 0.2 s is unstable"));
    assert!(refused(&["failed_jets:=[jet_99]"]).contains("no jet jet_99"));
    assert!(refused(&["limits.reference_tilt_margin_rad:=0.2"]).contains("tilt margin"));
    assert!(refused(&["actuators:=rockets"]).contains("wheels, motors, jets, both"));
    assert!(refused(&["safe_mode.redamp_rate_rad_s:=0.001"]).contains("coast_rate_rad_s"));
    assert!(refused(&["unloading.engage_share:=0.05"]).contains("release_share"));
    // Jets that cannot push in some direction: with three wheels beside them they may.
    let failed = "failed_jets:=[jet_1, jet_2, jet_3, jet_4, jet_5, jet_6, jet_7, jet_8, jet_9]";
    let text = refused(&["actuators:=jets", failed]);
    assert!(
        text.contains("jets that have not failed give no torque along [")
            && text.contains("A jet whose torque"),
        "{text}"
    );
    let both = tree(&["actuators:=both", failed]).for_node("/whorl_1/local_control");
    assert!(try_read(&both, crate::parameters::read).is_ok());
    let parameters = parameters("whorl_1", &[]);
    assert_eq!(parameters.platform, PlatformId(0));
    assert!(Vector3::from(parameters.gains.damping).iter().all(|d| *d > 0.5));
}

#[test]
fn allocations_can_be_compared_with_the_exact_oracle_while_it_runs() {
    for actuators in ["wheels", "jets", "both"] {
        let actuators_argument = format!("actuators:={actuators}");
        let arguments = [actuators_argument.as_str(), "check_allocation:=true", "failed_jets:=[jet_3]"];
        let mut rig = Rig::holding("whorl_1", &arguments, balanced());
        rig.run(10.0);
        let compared = count(&mut rig, "allocations compared with the oracle");
        assert!(compared >= 90, "{actuators}: {compared}");
        assert_eq!(count(&mut rig, "allocations that disagree with it"), 0, "{actuators}");
    }
    assert_eq!(count(&mut tracking(), "allocations compared with the oracle"), 0, "not unless asked for");
}
