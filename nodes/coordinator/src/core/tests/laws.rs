//! Every law in the coordinator: what it reads, what it refuses, and one taking over from another.

use super::*;
use whorl_control::formation::{RegisteredLaw, catalogue};

const HEAD: &str = "
/coordinator:
  ros__parameters:
    limits:
      whorl_2: {tilt_kind: pitch, tilt_max_deg: 30.0}
";

fn with(law: &str, steps: &str) -> String {
    format!("{HEAD}    law:\n{law}    steps:\n{steps}")
}

const TURN: &str = "      turn: {kind: slew, duration_s: 40.0, yaw_deg: 15.0}\n";

#[test]
fn graphs_over_which_nothing_can_be_agreed_are_refused_in_a_sentence() {
    for (law, said) in [
        (
            "      kind: decentralised\n      members: {whorl_1: {goal_weight: 0.0}, whorl_2: {goal_weight: 0.0}}\n",
            "not connected",
        ),
        (
            "      kind: decentralised\n      members: {whorl_2: {neighbours: [], goal_weight: 0.0}}\n",
            "whorl_2",
        ),
        (
            "      members: {whorl_1: {leader: whorl_2}, whorl_2: {leader: whorl_1}}\n",
            "follow each other in a circle",
        ),
        (
            "      kind: decentralised\n      members: {whorl_1: {neighbours: [whorl_7]}}\n",
            "`whorl_7` is no platform",
        ),
        (
            "      kind: behavioural\n      members: {whorl_1: {neighbours: []}}\n",
            "neighbours must be mutual",
        ),
        ("      kind: decentralised\n      decentralised: {error_share: 0.9}\n", "0.769"),
        (
            "      kind: perceptive_frame\n      perceptive_frame: {perception_gain_s: 2.0}\n",
            "less than 1.600",
        ),
        ("      kind: behavioural\n      behavioural: {keeping_bandwidth_rad_s: 1.0}\n", "0 to 0.400"),
    ] {
        let error = read(&with(law, TURN)).unwrap_err();
        assert!(error.contains(said), "{law}: {error}");
    }
}

#[test]
fn every_law_of_the_catalogue_is_read_by_its_name() {
    assert!(catalogue().len() >= 5);
    for kind in catalogue().iter().map(RegisteredLaw::kind) {
        let first = read(&with(&format!("      kind: {kind}\n"), TURN)).unwrap();
        assert_eq!(first.law.name(), kind);
        let step = format!("      switch: {{kind: law, law: {kind}, duration_s: 40.0}}\n");
        let switched = read(&with("      members: {}\n", &step)).unwrap();
        assert_eq!(switched.law.laws.last().unwrap().name(), kind);
    }
}

#[test]
fn an_unknown_law_is_refused_with_the_nearest_and_all_names() {
    let switch = "      switch: {kind: law, law: perceptive_frames, duration_s: 40.0}\n";
    let texts = [with("      kind: perceptive_fame\n", TURN), with("      members: {}\n", switch)];
    for error in texts.map(|text| read(&text).unwrap_err()) {
        assert!(error.contains("did you mean perceptive_frame?"), "{error}");
        assert!(catalogue().iter().all(|law| error.contains(law.kind())), "{error}");
    }
}

#[test]
fn keys_of_a_law_that_is_not_used_are_unknown() {
    let error = read(&with("      kind: leader_follower\n      decentralised: {error_share: 0.1}\n", TURN));
    assert!(error.unwrap_err().contains("error_share"));
    let error = read(&with("      members: {whorl_1: {goal_weight: 1.0}}\n", TURN));
    assert!(error.unwrap_err().contains("goal_weight"));
}

#[test]
fn laws_take_over_from_each_other_without_a_bump() {
    let kinds: Vec<&str> = catalogue().iter().map(RegisteredLaw::kind).collect();
    // In the middle of a slew, and in the middle of a swing.
    for motion in [
        "{kind: slew, duration_s: 5.0, yaw_deg: 20.0}",
        "{kind: scan, duration_s: 60.0, axis: yaw, amplitude_deg: 8.0, period_s: 20.0}",
    ] {
        for (index, from) in kinds.iter().enumerate() {
            let to = kinds[(index + 2) % kinds.len()];
            let steps = format!(
                "      settle: {{kind: settle, duration_s: 12.0}}
      move: {motion}
      switch: {{kind: law, law: {to}, duration_s: 40.0}}
      hold: {{kind: hold, duration_s: 5.0}}
"
            );
            let steps = steps.replace("duration_s: 60.0, axis", "duration_s: 25.0, axis");
            let law =
                format!("      kind: {from}\n      members: {{whorl_2: {{offset: {{yaw_deg: 20.0}}}}}}\n");
            let mut lab = Laboratory::new(&with(&law, &steps));
            lab.run_until(FormationState::PHASE_FINISHED, 95.0);
            for references in &lab.references {
                smoothness(references).check();
            }
            assert_eq!(lab.state().law, to);
            let relative = lab.relative_yaw_deg();
            assert!((relative - 20.0).abs() < 0.02, "{from} to {to}: {relative}");
            if motion.contains("slew") {
                let turned = YawPitchRoll::of(&lab.platforms[0].q_world_body).yaw_rad - START_YAW_RAD;
                assert!((turned.to_degrees() - 20.0).abs() < 0.05, "{from} to {to}: {}", turned.to_degrees());
            }
        }
    }
}

#[test]
fn an_offset_that_swings_is_followed_without_lag() {
    let steps = "      settle: {kind: settle, duration_s: 15.0}
      swing: {kind: offset_scan, platform: whorl_2, duration_s: 40.0, axis: yaw, amplitude_deg: 4.0, period_s: 20.0}
";
    let mut lab = Laboratory::new(&with("      members: {whorl_2: {offset: {yaw_deg: 20.0}}}\n", steps));
    lab.run(22.0);
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..2000 {
        lab.step();
        let relative = lab.relative_yaw_deg();
        (lowest, highest) = (lowest.min(relative), highest.max(relative));
        let error = Vector3::from(lab.state().relative_error_rad[1]).norm();
        assert!(error < 1e-3, "{error}");
    }
    assert!((highest - 24.0).abs() < 0.05 && (lowest - 16.0).abs() < 0.05, "{lowest} {highest}");
}

#[test]
fn with_a_member_gone_the_rest_go_on_where_the_law_and_the_user_allow_it() {
    for (law, goes_on) in [
        ("decentralised", true),
        ("behavioural", true),
        ("perceptive_frame", true),
        ("leader_follower", true),
        ("virtual_structure", false),
    ] {
        let law = format!("      kind: {law}\n");
        let steps = "      settle: {kind: settle, duration_s: 12.0}
      turn: {kind: slew, duration_s: 60.0, yaw_deg: 15.0}
";
        let text = with(&law, steps).replace(
            "    law:\n",
            "    link: {leader_waits: false}\n    faults: {wait_for_followers: false}\n    law:\n",
        );
        let mut lab = Laboratory::new(&text);
        lab.run(14.0);
        lab.platforms[1].cut = true;
        lab.run(45.0);
        let turned = YawPitchRoll::of(&lab.platforms[0].q_world_body).yaw_rad - START_YAW_RAD;
        assert_eq!((turned.to_degrees() - 15.0).abs() < 0.1, goes_on, "{law}: {}", turned.to_degrees());
    }
}

#[test]
fn a_pass_that_cannot_be_shown_is_refused_before_anything_moves() {
    let pass = |keys: &str| {
        let step = format!("      observe: {{kind: co_observe, duration_s: 100.0, {keys}}}\n");
        read(&with("      members: {whorl_2: {leader: whorl_1}}\n", &step))
    };
    assert!(pass("time_ratio: 4.0").is_ok());
    for (keys, said) in [
        ("orbit: {perigee_altitude_km: -50.0}", "above the ground"),
        ("time_ratio: 80.0", "lower time_ratio"),
        ("target: point, latitude_deg: 0.0, longitude_deg: 170.0", "below the horizon"),
        ("model: clohessy_wiltshire, orbit: {eccentricity: 0.1}", "hold for circular chiefs"),
        ("spacecraft: {whorl_2: {separation_m: 199000.0}}", "not small against the orbit"),
        ("settle_s: 95.0", "longer than both ramps"),
    ] {
        let error = pass(keys).map(|_| keys).unwrap_err();
        assert!(error.contains(said), "{keys}: {error}");
    }
}

#[test]
fn platforms_show_the_relative_attitude_of_the_pass_under_every_law() {
    for kind in ["leader_follower", "virtual_structure", "decentralised"] {
        let steps = "      observe: {kind: co_observe, duration_s: 100.0, settle_s: 30.0, time_ratio: 4.0, \
                     spacecraft: {whorl_2: {separation_m: 30000.0, phase_deg: 60.0}}}\n";
        let parameters = read(&with(&format!("      kind: {kind}\n"), steps)).unwrap();
        let parameters::StepKind::CoObserve(pass) = parameters.steps[0].kind.clone() else { panic!() };
        let mut lab = Laboratory::with(parameters);
        lab.run_until(FormationState::PHASE_MANOEUVRE, 5.0);
        lab.run(30.0);
        let mut began = 30.0;
        for _ in 0..6500 {
            lab.step();
            began += 0.01;
            let motion = |platform| pass.motion(platform, began, 0.0).unwrap().q_world_reference;
            let wanted = motion(0).inverse() * motion(1);
            let relative = lab.platforms[0].q_world_body.inverse() * lab.platforms[1].q_world_body;
            let error = attitude_error(&wanted, &relative).norm();
            assert!(error < 1.5e-3, "{kind} {began}: {error}");
        }
        let moved = attitude_error(
            &pass.motion(0, 0.0, 0.0).unwrap().q_world_reference,
            &pass.motion(0, 100.0, 0.0).unwrap().q_world_reference,
        );
        assert!(moved.norm() > 0.2);
    }
}
