//! Fault row: a sensor gives NaN, or freezes. It is rejected and reported, control is safe meanwhile, and
//! everything goes on when the sensor is back.

use std::time::Duration;

use whorl_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus};
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus};

use crate::support::formation::Formation;
use crate::support::watch::{Watch, route};

const LONG: Duration = Duration::from_secs(40);
const SOON: Duration = Duration::from_secs(8);

fn rejected_and_recovered(kind: &str) {
    // From the driver's start: long enough to be in the hold by then.
    let fault = format!("gyro: {{kind: {kind}, start_s: 14.0, length_s: 4.0}}");
    let layer = format!("/whorl_1/driver: {{ros__parameters: {{faults: {{{fault}}}}}}}");
    let (mut formation, watch) = Formation::holding_alone(&[&layer]);
    let estimate = route(0, Topic::AttitudeEstimate);
    let status = route(0, Topic::ControlStatus);
    watch.wait::<()>("the gyro to be rejected", LONG, |log| {
        let mut all = log.of::<AttitudeEstimate>(estimate);
        all.any(|(_, m)| m.usable() && m.flags & AttitudeEstimate::FLAG_GYRO_REJECTED == 0).then_some(())?;
        all.any(|(_, m)| m.flags & AttitudeEstimate::FLAG_GYRO_REJECTED != 0).then_some(())
    });
    reported(&watch, "estimator");
    watch.wait_next::<AttitudeEstimate>("the gyro to be accepted again", estimate, SOON, |m| {
        m.usable() && m.flags & AttitudeEstimate::FLAG_GYRO_REJECTED == 0
    });
    watch.wait_next::<ControlStatus>("tracking", status, SOON, |m| m.mode == ControlStatus::MODE_TRACK);
    for (_, m) in watch.log().of::<AttitudeEstimate>(estimate) {
        let numbers = [m.omega_wb_b_rad_s.x, m.omega_wb_b_rad_s.y, m.omega_wb_b_rad_s.z, m.q_world_body.w];
        assert!(!m.usable() || numbers.iter().all(|x| x.is_finite()), "NaN in an estimate: {m:?}");
    }
    formation.stop();
}

/// A node says in `/diagnostics` that not all is well.
fn reported(watch: &Watch, node: &str) {
    let name = format!("whorl_1: {node}");
    watch.wait_next::<DiagnosticArray>("a diagnostic", route(0, Topic::Diagnostics), SOON, |m| {
        m.status.iter().any(|s| s.name == name && s.level >= DiagnosticStatus::WARN)
    });
}

#[test]
fn a_gyro_of_nan_is_rejected_and_reported() {
    rejected_and_recovered("gyro_nan");
}

#[test]
fn a_frozen_gyro_is_rejected_and_reported() {
    rejected_and_recovered("gyro_frozen");
}
