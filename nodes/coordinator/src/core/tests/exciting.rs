//! Steps in which a platform plays an excitation of its own.

use super::*;

const EXCITED: &str = "
/coordinator:
  ros__parameters:
    experiment: {name: excited}
    law:
      members:
        whorl_2: {leader: \"\"}
    steps:
      settle: {kind: settle, duration_s: 2.0}
      spin: {kind: excite, duration_s: 10.0, excitation: spin_up, platform: whorl_1}
      stop: {kind: slew, duration_s: 15.0, pitch_deg: 1.0}
";

fn yaw_deg(lab: &Laboratory, platform: usize) -> f64 {
    YawPitchRoll::of(&lab.platforms[platform].q_world_body).yaw_rad.to_degrees()
}

#[test]
fn a_platform_plays_for_as_long_as_the_step_and_its_reference_goes_with_it() {
    let mut lab = Laboratory::new(EXCITED);
    lab.run_until(FormationState::PHASE_SETTLE, 5.0);
    let start_deg = yaw_deg(&lab, 0);
    let other_deg = yaw_deg(&lab, 1);
    lab.run_until(FormationState::PHASE_FINISHED, 40.0);
    let (first, last) = (lab.excitations.first().unwrap(), lab.excitations.last().unwrap());
    assert!(lab.excitations.iter().all(|e| e.name == "spin_up"));
    assert_eq!(lab.excitations.len(), 500);
    let length_s = Timestamp::from(last.valid_until).seconds_since(first.header.stamp.into());
    assert!((length_s - 10.0).abs() < 0.05 && first.elapsed_s < 0.03, "{length_s}");
    // 0.1 rad/s for 10 s, and a stop from there at 0.6 deg/s^2: 27 deg at most; nobody turns it back.
    let turned_deg = yaw_deg(&lab, 0) - start_deg;
    assert!((57.0..86.0).contains(&turned_deg), "{turned_deg}");
    let pitch_deg = YawPitchRoll::of(&lab.platforms[0].q_world_body).pitch_rad.to_degrees();
    assert!((pitch_deg - 1.0).abs() < 0.01, "{pitch_deg}");
    assert!((yaw_deg(&lab, 1) - other_deg).abs() < 0.01);
    assert!(lab.core.abort_reason().is_none());
}

#[test]
fn an_experiment_that_waits_plays_nothing() {
    let mut lab = Laboratory::new(EXCITED);
    lab.run_until(FormationState::PHASE_MANOEUVRE, 10.0);
    lab.run(1.0);
    lab.platforms[1].safe = true;
    lab.run(2.0);
    let played = lab.excitations.len();
    lab.run(1.0);
    assert_eq!(lab.excitations.len(), played);
    assert!(lab.state().step.contains("waiting"));
    lab.platforms[1].safe = false;
    lab.run(1.0);
    assert!(lab.excitations.len() > played);
}

#[test]
fn an_excitation_that_a_platform_does_not_know_ends_the_experiment() {
    let mut lab = Laboratory::new(EXCITED);
    lab.run_until(FormationState::PHASE_MANOEUVRE, 10.0);
    for _ in 0..3000 {
        lab.step();
        let mut status = ControlStatus {
            mode: ControlStatus::MODE_HOLD,
            reason: ControlStatus::REASON_EXCITATION_UNKNOWN,
            ..ControlStatus::default()
        };
        status.header.stamp = lab.now.into();
        lab.platforms[0].silent_control = true;
        lab.send(0, Topic::ControlStatus, status);
    }
    let reason = lab.core.abort_reason().unwrap();
    assert!(reason.contains("whorl_1") && reason.contains("no excitation of this name"), "{reason}");
}
