//! The radio link between the computers: delay, loss, cuts.

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
use whorl_node::Timestamp;

use crate::support::machine::Load;
use crate::support::simulation::{Run, parameters, rms, simulate};
use crate::support::watch::route;

const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

fn run(experiment: &str, layer: &str) -> Run {
    let _share = Load::Computation.take();
    let run = simulate(&parameters(&PLATFORMS, experiment, &[layer]), 3, 400.0);
    assert!(run.finished, "{:?}", run.lines.last());
    let last = run.states().next_back().unwrap().1.phase;
    assert_eq!(last, FormationState::PHASE_FINISHED, "{:?}", run.lines.last());
    run
}

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(seconds)
}

fn cut(start_s: f64, length_s: f64) -> String {
    format!(
        "/simulation: {{ros__parameters: {{link: {{cuts: {{one: {{start_s: {start_s}, length_s: {length_s}}}}}}}}}}}"
    )
}

fn statuses(run: &Run, platform: u16) -> impl Iterator<Item = (Timestamp, &ControlStatus)> {
    run.of(route(platform, Topic::ControlStatus))
}

#[test]
fn a_poor_link_costs_little_accuracy() {
    let layer = "/simulation: {ros__parameters: {link: {delay_s: 0.02, jitter_s: 0.01, loss: 0.05}}}";
    let run = run("leader_follower_short", layer);
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    assert!(error_deg < 0.1, "{error_deg} deg");
    let safe = statuses(&run, 1).filter(|(_, m)| m.mode >= ControlStatus::MODE_SAFE_DAMPING).count();
    assert_eq!(safe, 0, "the follower went to its safe mode");
}

#[test]
fn after_a_cut_in_the_slew_the_formation_goes_on_and_holds_as_well_as_ever() {
    // The slew is from 17 to 37 s. In the cut the actuators of both platforms are off, and they swing.
    let run = run("leader_follower", &cut(25.0, 15.0));
    let ages: Vec<f64> = run
        .states()
        .filter(|(t, _)| (at(39.0)..at(39.9)).contains(t))
        .map(|(_, m)| m.link_age_s[1])
        .collect();
    assert!(ages.iter().all(|age| *age > 13.5), "link ages in the cut: {ages:?}");
    for platform in 0..2 {
        // Within two seconds of the link's return.
        let mode = statuses(&run, platform).find(|(t, _)| *t >= at(42.0)).unwrap().1.mode;
        assert_eq!(mode, ControlStatus::MODE_TRACK, "platform {platform}");
    }
    let errors = run.relative_errors_in_hold();
    let last_hold = &errors[errors.len() - 2500..];
    let error_deg = rms(last_hold).to_degrees();
    assert!(error_deg < 0.1, "{error_deg} deg");
}

#[test]
fn in_a_cut_each_platform_comes_to_rest_and_is_then_let_go() {
    let run = run("leader_follower", &cut(25.0, 15.0));
    for platform in 0..2 {
        let modes: Vec<(Timestamp, u8)> = statuses(&run, platform)
            .filter(|(t, _)| (at(26.0)..at(40.0)).contains(t))
            .map(|(t, m)| (t, m.mode))
            .collect();
        assert_eq!(modes[0].1, ControlStatus::MODE_HOLD, "platform {platform} one second into the cut");
        let let_go = modes.iter().find(|(_, mode)| *mode == ControlStatus::MODE_IDLE);
        let let_go = let_go.unwrap_or_else(|| panic!("platform {platform} was not let go")).0;
        let rate = run
            .of::<AttitudeEstimate>(route(platform, Topic::TruthState))
            .find(|(t, _)| *t >= let_go)
            .map(|(_, m)| nalgebra::Vector3::from(m.omega_wb_b_rad_s).norm().to_degrees())
            .unwrap();
        assert!(rate < 0.3, "platform {platform} was let go at {let_go} with {rate} deg/s");
        assert!(modes.iter().all(|(_, mode)| *mode <= ControlStatus::MODE_HOLD), "platform {platform}");
    }
}
