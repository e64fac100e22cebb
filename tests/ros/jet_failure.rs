//! Fault row: a jet fails. Control goes on with that jet at zero.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ActuatorCommand, ControlStatus, ThrusterState};
use whorl_params::Value;
use whorl_ros::ParameterClient;

use crate::support::formation::Formation;
use crate::support::watch::route;

const SOON: Duration = Duration::from_secs(10);

#[test]
fn a_failed_jet_is_left_out_by_the_allocation() {
    // Pitched away from its balance, so that jet 2 or 7 must push all the time.
    let experiment = r#"
/coordinator:
  ros__parameters:
    steps:
      settle: {kind: settle, duration_s: 5.0, yaw_deg: 0.0, pitch_deg: 1.0, roll_deg: 2.0}
/whorl_1/local_control: {ros__parameters: {actuators: jets}}
/whorl_1/driver: {ros__parameters: {faults: {jet: {kind: jet_stuck_closed, jet: jet_2, start_s: 1.0e+9}}}}
"#;
    let (mut formation, watch) = Formation::holding_alone(&[experiment]);
    let thrusters = route(0, Topic::ThrusterState);
    let commands = route(0, Topic::ActuatorCommand);
    watch.wait_next::<ActuatorCommand>("jet 2 to be needed", commands, SOON, |m| m.jet_on_time_s[1] > 0.0);
    let participant = formation.participant();
    let driver = ParameterClient::new(&participant, "/whorl_1/driver").unwrap();
    // From the driver's start, so: now.
    driver.set(&participant, "faults.jet.start_s", &Value::Double(0.0), SOON).unwrap();
    let failed = watch.wait("the failure", SOON, |log| {
        log.of::<ThrusterState>(thrusters)
            .find(|(_, m)| m.health[1] == ThrusterState::HEALTH_FAILED)
            .map(|(at, _)| at)
    });
    let status = route(0, Topic::ControlStatus);
    let known = watch.wait("control to know", Duration::from_secs(5), |log| {
        log.of::<ControlStatus>(status).find(|(_, m)| m.jet_failed[1]).map(|(at, _)| at)
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
    for (_, m) in log.after::<ControlStatus>(status, known) {
        assert_eq!(m.mode, ControlStatus::MODE_TRACK, "reason {}", m.reason);
        let error = nalgebra::Vector3::from(m.attitude_error_b_rad).norm().to_degrees();
        assert!(error < 1.0, "{error} deg");
    }
    drop(log);
    formation.stop();
}
