//! Links that are cut and platforms that do not follow.

use super::*;

/// In the middle of the slew.
fn slewing() -> Laboratory {
    let mut lab = Laboratory::new(PAIR);
    lab.run_until(FormationState::PHASE_MANOEUVRE, 20.0);
    lab.run(4.0);
    lab
}

#[test]
fn a_leader_that_is_lost_stops_its_follower_smoothly_and_it_rejoins_by_itself() {
    for cut_s in [0.5, 5.0, 60.0] {
        let mut lab = slewing();
        let rate = reference_of(lab.references[1].last().unwrap()).omega_wr_r_rad_s.norm();
        assert!(rate > 0.01, "the follower is on its way");
        lab.platforms[0].cut = true;
        lab.run(cut_s);
        let state = lab.state();
        assert!(!state.link_ok[0] && state.link_ok[1]);
        assert!(state.link_age_s[0] > 0.4);
        assert!(Vector3::from(state.relative_error_rad[1]).x.is_nan());
        assert!(state.step.contains("waiting"));
        let last = lab.references[1].last().unwrap();
        assert_eq!(last.mode, AttitudeReference::MODE_HOLD);
        if cut_s > 4.0 {
            assert_eq!(reference_of(last).omega_wr_r_rad_s, Vector3::zeros());
        }
        lab.platforms[0].cut = false;
        lab.run(0.2);
        assert_eq!(lab.references[1].last().unwrap().mode, AttitudeReference::MODE_TRACK);
        lab.run_until(FormationState::PHASE_FINISHED, 60.0);
        lab.check_end();
        smoothness(&lab.references[1]).check();
    }
}

#[test]
fn a_follower_that_is_lost_makes_the_leader_wait_or_not_as_told() {
    for (waits, slew_ends) in [(true, false), (false, true)] {
        let experiment =
            PAIR.replace("    limits:\n", &format!("    link: {{leader_waits: {waits}}}\n    limits:\n"));
        let mut lab = Laboratory::new(&experiment);
        lab.run_until(FormationState::PHASE_MANOEUVRE, 20.0);
        lab.run(2.0);
        lab.platforms[1].cut = true;
        lab.run(14.0);
        assert_eq!(lab.core.phase() == FormationState::PHASE_HOLD, slew_ends, "waits: {waits}");
        lab.platforms[1].cut = false;
        if waits {
            lab.run_until(FormationState::PHASE_FINISHED, 60.0);
            lab.check_end();
        }
        smoothness(&lab.references[0]).check();
    }
}

#[test]
fn a_platform_that_moved_while_unseen_starts_anew_from_where_it_is() {
    let mut lab = slewing();
    lab.platforms[1].cut = true;
    lab.run(10.0);
    let turn = YawPitchRoll { yaw_rad: 0.2, ..YawPitchRoll::default() };
    let moved = lab.platforms[1].q_world_body * turn.attitude();
    lab.platforms[1].q_world_body = moved;
    lab.platforms[1].reference = None;
    lab.platforms[1].cut = false;
    lab.run(0.06);
    let reference = reference_of(lab.references[1].last().unwrap()).q_world_reference;
    assert!(attitude_error(&moved, &reference).norm() < 0.01, "it does not pull the platform back");
    lab.run_until(FormationState::PHASE_FINISHED, 60.0);
    assert!((lab.relative_yaw_deg() - 20.0).abs() < 0.1, "{}", lab.relative_yaw_deg());
}

#[test]
fn a_link_that_is_cut_towards_a_platform_only_is_waited_for_as_one_that_is_cut_both_ways() {
    // Far beyond `faults.timeout_s`.
    for platform in [0, 1] {
        let mut lab = slewing();
        lab.platforms[platform].deaf = true;
        lab.run(125.0);
        assert_ne!(lab.core.phase(), FormationState::PHASE_ABORTED, "{:?}", lab.core.abort_reason());
        assert!(lab.state().step.contains("waiting"), "{}", lab.state().step);
        lab.platforms[platform].deaf = false;
        lab.run_until(FormationState::PHASE_FINISHED, 60.0);
        lab.check_end();
        assert_eq!(lab.core.failure(), None);
    }
}

#[test]
fn safe_mode_pauses_the_experiment_and_it_goes_on_after() {
    let mut lab = slewing();
    lab.platforms[1].safe = true;
    lab.run(0.5);
    assert!(!lab.state().step.contains("waiting"), "not yet: the grace");
    lab.run(7.0);
    assert!(lab.state().step.contains("waiting"));
    assert!(lab.log.iter().any(|l| l.contains("whorl_2: control is in safe mode")), "{:?}", lab.log);
    let leader = reference_of(lab.references[0].last().unwrap());
    assert_eq!(leader.omega_wr_r_rad_s, Vector3::zeros(), "the leader waits");
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_TRACK);
    lab.platforms[1].safe = false;
    lab.run_until(FormationState::PHASE_FINISHED, 60.0);
    lab.check_end();
    // The follower's own reference went with it while it was in safe mode, and so may jump.
    smoothness(&lab.references[0]).check();
    assert!(lab.state().run_length_s > 32.0 + 4.0, "the wait is part of the length");
}

#[test]
fn a_platform_that_stays_in_safe_mode_or_silent_aborts_the_experiment() {
    for safe in [true, false] {
        let mut lab = slewing();
        lab.platforms[0].safe = safe;
        lab.platforms[0].silent_control = !safe;
        lab.run(19.0);
        assert_ne!(lab.core.phase(), FormationState::PHASE_ABORTED);
        lab.run(5.0);
        assert_eq!(lab.core.phase(), FormationState::PHASE_ABORTED);
        assert!(lab.core.abort_reason().unwrap().contains("whorl_1"), "{:?}", lab.core.abort_reason());
        assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_ABORT);
        lab.run(10.0);
        assert!(lab.core.finished());
        assert!(lab.core.failure().unwrap().contains("whorl_1"), "{:?}", lab.core.failure());
    }
}

#[test]
fn a_link_that_never_returns_ends_the_experiment() {
    let experiment = PAIR.replace("    limits:\n", "    link: {timeout_s: 30.0}\n    limits:\n");
    let mut lab = Laboratory::new(&experiment);
    lab.run(10.0);
    lab.platforms[0].cut = true;
    lab.run(29.0);
    assert_ne!(lab.core.phase(), FormationState::PHASE_ABORTED);
    lab.run(3.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_ABORTED);
    assert!(lab.core.abort_reason().unwrap().contains("link stayed stale"));
}

#[test]
fn a_suspended_shell_does_not_make_a_reference_jump() {
    let mut lab = slewing();
    let before = reference_of(lab.references[0].last().unwrap());
    // Stopped for 0.15 s: then three timers fire at once.
    lab.now = Timestamp(lab.now.0 + 150_000_000);
    for platform in &mut lab.platforms {
        platform.authority_until = Timestamp(lab.now.0 + 400_000_000);
    }
    lab.step();
    lab.deliver(Event::Timer);
    lab.deliver(Event::Timer);
    let after = reference_of(lab.references[0].last().unwrap());
    assert!(attitude_error(&before.q_world_reference, &after.q_world_reference).norm() < 0.01);
    lab.run_until(FormationState::PHASE_FINISHED, 60.0);
}
