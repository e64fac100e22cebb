//! Wheels that turn too fast are brought back by the jets, without letting go of the attitude.

use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::ThrusterState;

use crate::support::machine::Load;
use crate::support::measured;
use crate::support::simulation::{parameters, rms, simulate};
use crate::support::watch::route;

const EXPERIMENT: &str = r#"
/coordinator:
  ros__parameters:
    experiment: {name: unload, description: "hold while the wheels of Whorl-I are unloaded"}
    law: {kind: leader_follower, members: {whorl_2: {leader: whorl_1, offset: {yaw_deg: 20.0}}}}
    steps:
      settle: {kind: settle, duration_s: 5.0, yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0}
      hold: {kind: hold, duration_s: 120.0}
/whorl_1/driver:
  ros__parameters:
    initial: {yaw_deg: 0.0, pitch_deg: -0.6, roll_deg: 2.0, wheel_speed_rad_s: [0.0, 0.0, 250.0]}
/whorl_2/driver:
  ros__parameters:
    initial: {yaw_deg: 19.0, pitch_deg: -0.5, roll_deg: 1.0}
"#;

#[test]
fn jets_unload_a_fast_wheel_while_the_platform_points() {
    let _share = Load::Computation.take();
    let run = simulate(&parameters(&["whorl_1", "whorl_2"], EXPERIMENT, &[]), 4, 300.0);
    assert!(run.finished, "{:?}", run.lines.last());
    let speeds: Vec<f64> =
        run.of::<JointState>(route(0, Topic::WheelState)).map(|(_, m)| m.velocity[2]).collect();
    let (first, last) = (speeds[0], *speeds.last().unwrap());
    assert!(first > 240.0, "{first} rad/s");
    let gas_s: f64 = run
        .of::<ThrusterState>(route(0, Topic::ThrusterState))
        .next_back()
        .map(|(_, m)| m.total_on_time_s.iter().sum())
        .unwrap();
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    measured(&format!(
        "wheel {first:.0} to {last:.0} rad/s, jets on for {gas_s:.1} s, error {error_deg:.4} deg"
    ));
    // 250 rad/s of 0.02 kg m^2 are 5 N m s: 14 s of two jets of 0.4 N at 0.45 m.
    assert!(last.abs() < 100.0, "{last} rad/s after the run");
    assert!(gas_s > 5.0, "momentum went without gas: {gas_s} s");
    assert!(error_deg < 0.1, "{error_deg} deg");
}
