//! The radio link between the computers: delay, loss, cuts.

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{ControlStatus, FormationState};
use whorl_node::Timestamp;

use crate::support::machine::Load;
use crate::support::simulation::{Run, parameters, rms, simulate};
use crate::support::watch::route;

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

fn run(layer: &str) -> Run {
    let _share = Load::Light.take();
    let run = simulate(&parameters(&PLATFORMS, "leader_follower_short", &[layer]), 3, 200.0);
    assert!(run.finished, "{:?}", run.lines.last());
    let last = run.states().next_back().unwrap().1.phase;
    assert_eq!(last, FormationState::PHASE_FINISHED, "{:?}", run.lines.last());
    run
}

#[test]
fn a_poor_link_costs_little_accuracy() {
    let run = run("/simulation: {ros__parameters: {link: {delay_s: 0.02, jitter_s: 0.01, loss: 0.05}}}");
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    assert!(error_deg < 0.1, "{error_deg} deg");
    let modes: Vec<u8> = run.of::<ControlStatus>(route(1, Topic::ControlStatus)).map(|(_, m)| m.mode).collect();
    let safe = modes.iter().filter(|m| **m >= ControlStatus::MODE_SAFE_DAMPING).count();
    assert_eq!(safe, 0, "the follower went to its safe mode");
}

#[test]
fn after_a_cut_in_the_slew_the_formation_goes_on_and_ends_as_if_there_had_been_none() {
    // The slew is from 7 s after the start of the experiment on.
    let run = run("/simulation: {ros__parameters: {link: {cuts: {one: {start_s: 14.0, length_s: 10.0}}}}}");
    let at = |seconds: f64| Timestamp::from_seconds(seconds);
    let ages: Vec<f64> = run
        .states()
        .filter(|(t, _)| (at(23.0)..at(23.9)).contains(t))
        .map(|(_, m)| m.link_age_s[1])
        .collect();
    assert!(ages.iter().all(|age| *age > 8.5), "link ages in the cut: {ages:?}");
    // Within two seconds of the link's return every platform tracks again.
    for platform in 0..2 {
        let mode = run
            .of::<ControlStatus>(route(platform, Topic::ControlStatus))
            .find(|(t, _)| *t >= at(26.0))
            .unwrap()
            .1
            .mode;
        assert_eq!(mode, ControlStatus::MODE_TRACK, "platform {platform}");
    }
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    assert!(error_deg < 0.1, "{error_deg} deg");
}

#[test]
fn in_a_cut_each_platform_comes_to_rest_and_stays_where_it_is() {
    use whorl_msgs::whorl::AttitudeEstimate;
    let run = run("/simulation: {ros__parameters: {link: {cuts: {one: {start_s: 14.0, length_s: 12.0}}}}}");
    for platform in 0..2 {
        let fastest = run
            .of::<AttitudeEstimate>(route(platform, Topic::TruthState))
            .filter(|(t, _)| (Timestamp::from_seconds(24.0)..Timestamp::from_seconds(26.0)).contains(t))
            .map(|(_, m)| nalgebra::Vector3::from(m.omega_wb_b_rad_s).norm())
            .fold(0.0, f64::max);
        assert!(fastest.to_degrees() < 0.1, "platform {platform}: {} deg/s", fastest.to_degrees());
    }
}
