//! Faults of sensors and jets in simulation: the same responses as over DDS, and how quick and how exact they are.

use std::time::Duration;

use whorl_msgs::geometry_msgs::Quaternion;
use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{
    ActuatorCommand, AttitudeEstimate, AttitudeReference, ControlStatus, FormationState,
};
use whorl_node::Timestamp;

use crate::support::formation::LONG_HOLD_ALONE;
use crate::support::machine::Load;
use crate::support::simulation::{Run, parameters, rms, simulate};
use crate::support::watch::route;

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

fn run(faults: &str) -> Run {
    let _share = Load::Computation.take();
    let layer = format!("/whorl_1/driver: {{ros__parameters: {{faults: {{{faults}}}}}}}");
    simulate(&parameters(&PLATFORMS, "leader_follower_short", &[&layer]), 5, 200.0)
}

fn estimates(run: &Run, from_s: f64, to_s: f64) -> Vec<&AttitudeEstimate> {
    let span = Timestamp::from_seconds(from_s)..Timestamp::from_seconds(to_s);
    run.of(route(0, Topic::AttitudeEstimate)).filter(|(t, _)| span.contains(t)).map(|(_, m)| m).collect()
}

fn last_phase(run: &Run) -> u8 {
    run.states().next_back().unwrap().1.phase
}

#[test]
fn a_gyro_that_turns_to_nan_is_rejected_and_the_experiment_goes_on_when_it_is_back() {
    let run = run("nan: {kind: gyro_nan, start_s: 15.0, length_s: 3.0}");
    let during = estimates(&run, 15.5, 17.9);
    assert!(!during.is_empty(), "the estimator fell silent");
    for estimate in during {
        assert_ne!(estimate.flags & AttitudeEstimate::FLAG_GYRO_REJECTED, 0, "not reported");
        assert!(estimate.q_world_body.to_unit().is_some(), "NaN went through");
    }
    let safe = run
        .of::<ControlStatus>(route(0, Topic::ControlStatus))
        .any(|(t, m)| m.mode >= ControlStatus::MODE_SAFE_DAMPING && t > Timestamp::from_seconds(15.0));
    assert!(safe, "control went on without a rate");
    assert!(estimates(&run, 24.0, 25.0).iter().all(|e| e.usable()), "the estimator did not recover");
    assert_eq!(last_phase(&run), FormationState::PHASE_FINISHED, "{:?}", run.lines.last());
}

#[test]
fn a_frozen_gyro_is_rejected() {
    let run = run("frozen: {kind: gyro_frozen, start_s: 15.0, length_s: 3.0}");
    let reported =
        estimates(&run, 15.5, 17.9).iter().all(|e| e.flags & AttitudeEstimate::FLAG_GYRO_REJECTED != 0);
    assert!(reported, "not reported");
    assert_eq!(last_phase(&run), FormationState::PHASE_FINISHED, "{:?}", run.lines.last());
}

#[test]
fn one_lost_jet_does_not_cost_the_hold() {
    let _share = Load::Computation.take();
    let layer = "/whorl_1/driver: {ros__parameters: {faults: {jet: {kind: jet_stuck_closed, jet: jet_3, start_s: 0.0}}}}";
    let run = simulate(&parameters(&PLATFORMS, "leader_follower_jets", &[layer]), 6, 600.0);
    assert_eq!(last_phase(&run), FormationState::PHASE_FINISHED, "{:?}", run.lines.last());
    let (_, status) = run.of::<ControlStatus>(route(0, Topic::ControlStatus)).next_back().unwrap();
    let failed: Vec<usize> = (0..12).filter(|jet| status.jet_failed[*jet]).collect();
    assert_eq!(failed, [2]);
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    assert!(error_deg <= 0.2, "{error_deg} deg");
}

#[test]
fn a_jet_that_fails_is_left_out_at_once_and_another_takes_its_place() {
    let _share = Load::Computation.take();
    // Pitched away from its balance, so that jet 2 or 7 must push where there are no wheels; one fails in the hold.
    let layers = [
        "/coordinator: {ros__parameters: {steps: {settle: {kind: settle, duration_s: 3.0, yaw_deg: 0.0, pitch_deg: 1.0, \
         roll_deg: 2.0}}}}",
        "/whorl_1/driver: {ros__parameters: {initial: {yaw_deg: 0.0, pitch_deg: 1.0, roll_deg: 2.0}, faults: {jet: {kind: \
         jet_stuck_closed, jet: jet_2, start_s: 30.0}}}}",
        "/**/local_control: {ros__parameters: {actuators: jets}}",
    ];
    let run = simulate(&parameters(&["whorl_1"], LONG_HOLD_ALONE, &layers), 5, 60.0);
    let statuses: Vec<(Timestamp, &ControlStatus)> = run.of(route(0, Topic::ControlStatus)).collect();
    let known = statuses.iter().find(|(_, m)| m.jet_failed[1]).unwrap().0;
    assert!((0.0..0.2).contains(&known.seconds_since(Timestamp::from_seconds(30.0))), "{known}");
    let commands: Vec<(Timestamp, &ActuatorCommand)> = run.of(route(0, Topic::ActuatorCommand)).collect();
    assert!(commands.iter().any(|(t, m)| *t < known && m.jet_on_time_s[1] > 0.0), "jet 2 was not needed");
    assert!(
        commands.iter().any(|(t, m)| *t > known && m.jet_on_time_s[6] > 0.0),
        "jet 7 does not take its place"
    );
    // Commands repeat the pulses of their slot of 0.1 s, which was planned before.
    for (at, command) in commands.iter().filter(|(t, _)| *t > known + Duration::from_millis(100)) {
        assert_eq!(command.jet_on_time_s[1], 0.0, "the failed jet is still commanded at {at}");
    }
    // Until the simulation ends.
    let later = Timestamp::from_seconds(25.0)..Timestamp::from_seconds(59.0);
    for (at, status) in statuses.iter().filter(|(t, _)| later.contains(t)) {
        assert_eq!(status.mode, ControlStatus::MODE_TRACK, "at {at}, reason {}", status.reason);
        let error_deg = nalgebra::Vector3::from(status.attitude_error_b_rad).norm().to_degrees();
        assert!(error_deg < 0.3, "{error_deg} deg at {at}");
    }
}

#[test]
fn a_reference_beyond_the_tilt_limit_is_clipped_and_the_platform_stays_inside() {
    let _share = Load::Computation.take();
    let layer =
        "/coordinator: {ros__parameters: {steps: {hold: {kind: slew, duration_s: 60.0, pitch_deg: 12.0}}}}";
    let run = simulate(&parameters(&["whorl_1"], LONG_HOLD_ALONE, &[layer]), 5, 60.0);
    let tilt_deg = |q: Quaternion| {
        let z = q.to_unit().unwrap() * nalgebra::Vector3::z();
        z.xy().norm().atan2(z.z).to_degrees()
    };
    let references = run.of::<AttitudeReference>(route(0, Topic::AttitudeReference));
    let asked_deg = references.map(|(_, m)| tilt_deg(m.q_world_reference)).fold(0.0, f64::max);
    let truth = run.of::<AttitudeEstimate>(route(0, Topic::TruthState));
    let done_deg = truth.map(|(_, m)| tilt_deg(m.q_world_body)).fold(0.0, f64::max);
    // The platform's stop is at 5 deg.
    assert!((3.0..5.0).contains(&asked_deg), "the reference is tilted by {asked_deg} deg");
    assert!((3.0..4.8).contains(&done_deg), "the platform is tilted by {done_deg} deg");
    assert!(run.states().any(|(_, m)| m.reference_clipped[0]));
    let safe = |m: &ControlStatus| m.mode >= ControlStatus::MODE_SAFE_DAMPING;
    assert!(
        !run.of(route(0, Topic::ControlStatus)).any(|(_, m)| safe(m)),
        "a clipped reference led into safe mode"
    );
}
