//! Fault row: tilt near its stop. References are clipped; beyond, control is safe. That the platform stays inside is asserted
//! in virtual time (`closed_loop::faults`).

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ControlStatus, FormationState};

use whorl_params::Value;

use super::held::{Held, SOON};
use crate::support::formation::STARTUP;
use crate::support::watch::route;

const LIMIT_DEG: f64 = 5.0;

/// Angle of the body's z axis to the vertical [deg].
fn tilt_deg(q: whorl_msgs::geometry_msgs::Quaternion) -> f64 {
    let z = q.to_unit().unwrap() * nalgebra::Vector3::z();
    z.xy().norm().atan2(z.z).to_degrees()
}

pub fn clips_a_reference_beyond_the_stop(held: &mut Held) {
    // Another experiment needs another coordinator.
    held.formation.kill("/coordinator");
    let begin = whorl_ros::wall_clock();
    let tilts = ["steps.hold.kind:=slew", "steps.hold.duration_s:=600.0", "steps.hold.pitch_deg:=12.0"];
    held.formation.start_with("/coordinator", &tilts.map(str::to_owned));
    let watch = &held.watch;
    watch.wait_next::<FormationState>("the clipping", route(0, Topic::FormationState), STARTUP, |m| {
        m.reference_clipped[0]
    });
    watch.wait_next::<AttitudeEstimate>("the platform to tilt", route(0, Topic::TruthState), SOON, |m| {
        tilt_deg(m.q_world_body) > 3.0
    });
    let log = watch.log();
    let references = log.after::<AttitudeReference>(route(0, Topic::AttitudeReference), begin);
    let asked = references.map(|(_, m)| tilt_deg(m.q_world_reference)).fold(0.0, f64::max);
    assert!((3.0..LIMIT_DEG).contains(&asked), "reference tilted by {asked} deg");
    let status = route(0, Topic::ControlStatus);
    drop(log);

    // Now the limit comes nearer than the platform is: safe, until it is back.
    held.set_control("limits.safe_tilt_margin_rad", &Value::Double(0.035));
    watch.wait_next::<ControlStatus>("safe mode for tilt", status, SOON, |m| {
        m.mode >= ControlStatus::MODE_SAFE_DAMPING && m.reason == ControlStatus::REASON_TILT_LIMIT
    });
    held.set_control("limits.safe_tilt_margin_rad", &Value::Double(0.0035));
    watch.wait_next::<ControlStatus>("tracking again", status, SOON, |m| m.mode == ControlStatus::MODE_TRACK);
}
