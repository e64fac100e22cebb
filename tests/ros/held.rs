//! Fault rows of one platform, one after the other in one formation that holds.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::ControlStatus;
use whorl_params::Value;
use whorl_ros::{ParameterClient, Participant};

use super::{jet_failure, sensor_faults, tilt_limit};
use crate::support::formation::{Formation, STARTUP};
use crate::support::watch::{Watch, route};

/// A fault that a test switches on and off: it never starts by itself.
pub const NEVER_S: f64 = 1e9;
/// For an answer of a node, and until the platform has swung back and points where it should, on a busy machine.
pub const SOON: Duration = STARTUP;

/// Whorl-I in a long hold, its parameters, and its observer. Between two faults it is healthy and points.
pub struct Held {
    pub formation: Formation,
    pub watch: Watch,
    participant: Participant,
    driver: ParameterClient,
    control: ParameterClient,
}

/// Pitched away from its balance, so that jet 2 or 7 must push when there are no wheels.
const EXPERIMENT: &str = r#"
/coordinator:
  ros__parameters:
    steps:
      settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: 1.0, roll_deg: 2.0}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: 1.0, roll_deg: 2.0}
    faults:
      sensor: {kind: gyro_nan, start_s: 1.0e+9}
      jet: {kind: jet_stuck_closed, jet: jet_2, start_s: 1.0e+9}
"#;

impl Held {
    fn start() -> Self {
        let (formation, watch) = Formation::holding_alone(&[EXPERIMENT]);
        let participant = formation.participant();
        let client = |node| ParameterClient::new(&participant, node).unwrap();
        let (driver, control) = (client("/whorl_1/driver"), client("/whorl_1/local_control"));
        Self { formation, watch, participant, driver, control }
    }

    /// Sets a parameter of the driver. A fault's start counts from the driver's: 0 is now.
    pub fn set_driver(&self, name: &str, value: &Value) {
        self.driver.set(&self.participant, name, value, SOON).unwrap();
    }

    /// Sets a parameter of local control.
    pub fn set_control(&self, name: &str, value: &Value) {
        self.control.set(&self.participant, name, value, SOON).unwrap();
    }

    /// Waits until it tracks and is within this angle of its reference.
    pub fn wait_until_it_points(&mut self, within_deg: f64) {
        self.formation.check_alive();
        let points = |m: &ControlStatus| m.mode == ControlStatus::MODE_TRACK && error_deg(m) < within_deg;
        self.watch.wait_next("the platform to point", route(0, Topic::ControlStatus), SOON, points);
    }
}

/// Angle between where the platform points and where it should [deg].
pub fn error_deg(status: &ControlStatus) -> f64 {
    nalgebra::Vector3::from(status.attitude_error_b_rad).norm().to_degrees()
}

#[test]
fn a_platform_lives_with_broken_sensors_a_lost_jet_and_its_stops() {
    let mut held = Held::start();
    held.wait_until_it_points(0.2);
    sensor_faults::are_refused_and_reported_and_taken_back(&mut held);
    held.wait_until_it_points(0.2);
    jet_failure::is_left_out_by_the_allocation(&mut held);
    tilt_limit::clips_a_reference_beyond_the_stop(&mut held);
    held.formation.stop();
}
