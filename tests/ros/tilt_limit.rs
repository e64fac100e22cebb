//! Fault row: tilt near its stop. References are clipped; beyond, control is safe.

use std::time::Duration;

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ControlStatus, FormationState};

use whorl_params::Value;
use whorl_ros::ParameterClient;

use crate::support::formation::Formation;
use crate::support::watch::route;

const SOON: Duration = Duration::from_secs(10);
const LIMIT_DEG: f64 = 5.0;

/// Angle of the body's z axis to the vertical [deg].
fn tilt_deg(q: whorl_msgs::geometry_msgs::Quaternion) -> f64 {
    let z = q.to_unit().unwrap() * nalgebra::Vector3::z();
    z.xy().norm().atan2(z.z).to_degrees()
}

#[test]
fn a_reference_beyond_the_stop_is_clipped_and_the_platform_stays_inside() {
    let experiment = r#"
/coordinator:
  ros__parameters:
    steps:
      settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
      hold: {kind: slew, duration_s: 600.0, pitch_deg: 12.0}
/whorl_1/local_control: {ros__parameters: {actuators: both}}
"#;
    let (mut formation, watch) = Formation::holding_alone(&[experiment]);
    watch.wait_next::<FormationState>(
        "the clipping",
        route(0, Topic::FormationState),
        Duration::from_secs(30),
        |m| m.reference_clipped[0],
    );
    watch.during(Duration::from_secs(5));
    let log = watch.log();
    let most = |tilts: &mut dyn Iterator<Item = f64>| tilts.fold(0.0, f64::max);
    let asked = most(
        &mut log
            .of::<AttitudeReference>(route(0, Topic::AttitudeReference))
            .map(|(_, m)| tilt_deg(m.q_world_reference)),
    );
    let done = most(
        &mut log.of::<AttitudeEstimate>(route(0, Topic::TruthState)).map(|(_, m)| tilt_deg(m.q_world_body)),
    );
    assert!((3.0..LIMIT_DEG).contains(&asked), "reference tilted by {asked} deg");
    assert!((3.0..LIMIT_DEG - 0.2).contains(&done), "platform tilted by {done} deg");
    let safe = log
        .of::<ControlStatus>(route(0, Topic::ControlStatus))
        .any(|(_, m)| m.mode >= ControlStatus::MODE_SAFE_DAMPING);
    assert!(!safe, "a clipped reference led into safe mode");
    drop(log);

    // Now the limit comes nearer than the platform is: safe, until it is back.
    let participant = formation.participant();
    let control = ParameterClient::new(&participant, "/whorl_1/local_control").unwrap();
    control.set(&participant, "limits.safe_tilt_margin_rad", &Value::Double(0.035), SOON).unwrap();
    let status = route(0, Topic::ControlStatus);
    watch.wait_next::<ControlStatus>("safe mode for tilt", status, SOON, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING && m.reason == ControlStatus::REASON_TILT_LIMIT
    });
    control.set(&participant, "limits.safe_tilt_margin_rad", &Value::Double(0.0035), SOON).unwrap();
    watch.wait_next::<ControlStatus>("tracking again", status, SOON * 2, |m| {
        m.mode == ControlStatus::MODE_TRACK
    });
    formation.stop();
}
