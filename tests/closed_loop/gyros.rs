//! A platform that has nothing but control moment gyros slews and points.

use nalgebra::Vector3;
use whorl_msgs::sensor_msgs::JointState;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ControlStatus};
use whorl_node::Timestamp;

use crate::support::machine::Load;
use crate::support::measured;
use crate::support::simulation::{parameters, rms, simulate};
use crate::support::watch::route;

/// The experiment as it is run, by the truth.
#[test]
fn four_gyros_slew_a_platform_by_sixty_degrees_and_back() {
    let _share = Load::Computation.take();
    let run = simulate(&parameters(&["whorl_c"], "cmg_slew", &[]), 3, 200.0);
    assert!(run.finished, "{:?}", run.lines.last());
    let truth = run.truth(0);
    let references: Vec<(Timestamp, &AttitudeReference)> =
        run.of::<AttitudeReference>(route(0, Topic::AttitudeReference)).collect();
    let headings = || truth.values().map(whorl_math::azimuth_rad);
    let furthest_deg = headings().fold(0.0, f64::max).to_degrees();
    assert!((furthest_deg - 60.0).abs() < 1.0, "{furthest_deg} deg");
    // While the reference is at rest.
    let still = references.iter().filter(|(_, r)| Vector3::from(r.omega_wr_r_rad_s).norm() < 1e-6);
    let errors: Vec<f64> = still
        .filter_map(|(_, r)| {
            let (_, truth) = truth.range(Timestamp::from(r.header.stamp)..).next()?;
            Some(truth.angle_to(&r.q_world_reference.to_unit()?))
        })
        .collect();
    let pointing_deg = rms(&errors[errors.len() / 10..]).to_degrees();
    let gimbals: Vec<&JointState> =
        run.of::<JointState>(route(0, Topic::GimbalState)).map(|(_, m)| m).collect();
    let swept = gimbals.iter().flat_map(|m| &m.position).fold(0.0_f64, |most, x| most.max(x.abs()));
    let fastest = gimbals.iter().flat_map(|m| &m.velocity).fold(0.0_f64, |most, x| most.max(x.abs()));
    let least =
        run.of::<ControlStatus>(route(0, Topic::ControlStatus)).map(|(_, m)| m.alpha).fold(1.0, f64::min);
    measured(&format!(
        "gyros: {furthest_deg:.1} deg, pointing {pointing_deg:.4} deg RMS, gimbals to {:.0} deg and {fastest:.2} rad/s, \
         least share of torque {least:.3}",
        swept.to_degrees()
    ));
    assert!(pointing_deg < 0.1, "{pointing_deg} deg");
    assert!(swept > 0.2 && fastest <= 1.01, "{swept} rad, {fastest} rad/s");
    // No other actuator took part.
    assert!(gimbals.iter().all(|m| m.name.len() == 4 && m.position.len() == 4 && m.effort.len() == 4));
    assert!(run.of::<AttitudeEstimate>(route(0, Topic::AttitudeEstimate)).count() > 1000);
}
