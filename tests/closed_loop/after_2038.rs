//! The seconds of `builtin_interfaces/Time` have 31 bits and a sign: an experiment that runs across their end goes on as any.

use whorl_msgs::topics::Topic;
use whorl_msgs::whorl::{AttitudeEstimate, ControlStatus, FormationState};
use whorl_node::Timestamp;

use crate::support::machine::Load;
use crate::support::simulation::{parameters, rms, simulate_from};
use crate::support::watch::route;

/// 2038-01-19T03:14:08Z: the first second that 31 bits do not hold.
const END: Timestamp = Timestamp((1 << 31) * 1_000_000_000);
const PLATFORMS: [&str; 2] = ["whorl_1", "whorl_2"];

#[test]
fn an_experiment_runs_across_the_end_of_31_bits() {
    runs_across_the_end(60);
}

#[test]
#[ignore = "slow: a hold of ten minutes"]
fn an_experiment_goes_on_for_long_after_the_end_of_31_bits() {
    runs_across_the_end(600);
}

fn runs_across_the_end(hold_s: u32) {
    let _share = Load::Computation.take();
    // It begins a few seconds before.
    let layer = format!(
        "/coordinator: {{ros__parameters: {{steps: {{hold: {{kind: hold, duration_s: {hold_s}.0}}}}}}}}"
    );
    let tree = parameters(&PLATFORMS, "leader_follower_short", &[&layer]);
    let start = Timestamp(END.0 - 15_000_000_000);
    let run = simulate_from(start, &tree, 3, f64::from(hold_s) + 60.0);
    assert!(run.finished, "{:?}", run.lines.last());
    let (ended, last) = run.states().next_back().unwrap();
    assert!(ended > END && last.phase == FormationState::PHASE_FINISHED, "{ended}, phase {}", last.phase);
    for platform in 0..2 {
        let stamps: Vec<Timestamp> = run
            .of::<AttitudeEstimate>(route(platform, Topic::AttitudeEstimate))
            .map(|(_, m)| m.header.stamp.into())
            .collect();
        let back = stamps.windows(2).find(|pair| pair[1] < pair[0]);
        assert!(back.is_none(), "platform {platform}: stamps go back, {back:?}");
        assert!(stamps.last().is_some_and(|last| *last > END), "platform {platform}: {:?}", stamps.last());
        let safe = run
            .of::<ControlStatus>(route(platform, Topic::ControlStatus))
            .find(|(_, m)| m.mode >= ControlStatus::MODE_SAFE_DAMPING);
        assert!(safe.is_none(), "platform {platform} was safe at {}", safe.unwrap().0);
    }
    let error_deg = rms(&run.relative_errors_in_hold()).to_degrees();
    assert!(error_deg < 0.1, "{error_deg} deg");
}
