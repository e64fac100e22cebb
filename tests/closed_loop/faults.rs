//! Faults of sensors and jets in simulation: the same responses as over DDS, quickly checked.

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
use whorl_node::Timestamp;

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
