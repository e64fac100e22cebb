//! Waiting, start, steps, end, services, parameters.

use super::*;
use whorl_node::Configurable;

#[test]
fn a_whole_experiment_runs_through_its_phases_and_ends() {
    let mut lab = Laboratory::new(PAIR);
    let mut phases = vec![lab.core.phase()];
    for _ in 0..4000 {
        lab.step();
        if phases.last() != Some(&lab.core.phase()) {
            phases.push(lab.core.phase());
        }
        if lab.core.finished() {
            break;
        }
    }
    assert_eq!(phases, [0, 1, 2, 3, 4, 5]);
    assert!(lab.core.finished());
    // 1 s of health, 32 s of steps, 1 s at the end.
    assert!((lab.now.seconds() - 1034.0).abs() < 0.2, "{}", lab.now);
    assert!((lab.state().run_elapsed_s - 32.0).abs() < 0.05);
    assert_eq!(lab.state().run_length_s, 32.0);
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_STANDBY);
    lab.check_end();
    for references in &lab.references {
        smoothness(references).check();
    }
}

#[test]
fn the_first_reference_is_where_the_platform_is_and_rests() {
    let mut lab = Laboratory::new(PAIR);
    let start: Vec<_> = lab.platforms.iter().map(|p| p.q_world_body).collect();
    lab.run_until(FormationState::PHASE_SETTLE, 5.0);
    lab.run(0.1);
    for (references, q) in lab.references.iter().zip(start) {
        let first = reference_of(&references[0]);
        assert!(attitude_error(&q, &first.q_world_reference).norm() < 1e-9);
        assert_eq!(first.omega_wr_r_rad_s, Vector3::zeros());
    }
}

#[test]
fn rates_validities_and_sequence_numbers_are_as_promised() {
    let mut lab = Laboratory::new(PAIR);
    lab.run(10.0);
    let full = |counts: BTreeMap<i64, u32>, rate: u32| {
        counts.iter().filter(|(s, _)| (1004..1009).contains(*s)).all(|(_, n)| *n == rate)
    };
    assert!(full(rates(lab.references[1].iter().map(|r| r.header.stamp.into())), 50));
    assert!(full(rates(lab.commands.iter().map(|c| c.header.stamp.into())), 20));
    assert!(full(rates(lab.states.iter().map(|s| s.header.stamp.into())), 10));
    for (expected, command) in (0..).zip(&lab.commands) {
        assert_eq!(command.sequence, expected);
        let valid_s = Timestamp::from(command.valid_until).seconds_since(command.header.stamp.into());
        assert!((valid_s - 0.4).abs() < 1e-9);
    }
    for (expected, reference) in (0..).zip(&lab.references[0]) {
        assert_eq!(reference.sequence, expected);
        assert_eq!(reference.header.frame_id, "world");
    }
}

#[test]
fn it_waits_and_names_what_is_missing_until_time_runs_out() {
    let mut lab = Laboratory::new(PAIR);
    lab.platforms[1].cut = true;
    lab.run(59.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_WAITING);
    assert!(lab.references[0].is_empty());
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_STANDBY);
    let refused = lab.request(Service::StartExperiment, "");
    assert!(!refused.success && refused.message.contains("whorl_2: no attitude/estimate"), "{refused:?}");
    assert_eq!(lab.log.iter().filter(|line| line.contains("whorl_2")).count(), 1, "{:?}", lab.log);
    lab.run(3.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_ABORTED);
    assert!(lab.core.abort_reason().unwrap().contains("whorl_2: no attitude/estimate received"));
    assert!(lab.core.finished());
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_STANDBY);
}

#[test]
fn it_waits_for_a_controller_that_is_silent() {
    let mut lab = Laboratory::new(PAIR);
    lab.platforms[0].silent_control = true;
    lab.run(5.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_WAITING);
    assert!(lab.log.iter().any(|line| line.contains("whorl_1: no control/status")), "{:?}", lab.log);
    lab.platforms[0].silent_control = false;
    lab.run_until(FormationState::PHASE_SETTLE, 3.0);
}

#[test]
fn start_and_abort_by_service() {
    let mut lab = Laboratory::new(&PAIR.replace("name: pair", "name: pair, auto_start: false"));
    lab.run(5.0);
    assert_eq!(lab.core.phase(), FormationState::PHASE_READY);
    let wrong = lab.request(Service::StartExperiment, "another");
    assert_eq!(
        (wrong.success, wrong.message.as_str()),
        (false, "the experiment loaded is pair, not another")
    );
    assert!(lab.request(Service::StartExperiment, "pair").success);
    assert_eq!(lab.core.phase(), FormationState::PHASE_SETTLE);
    let again = lab.request(Service::StartExperiment, "");
    assert_eq!((again.success, again.message.as_str()), (false, "pair is already running"));
    lab.run(3.0);
    assert!(lab.request(Service::AbortExperiment, "smoke").success);
    // Commanded in the same step, not at the next heartbeat.
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_ABORT);
    assert_eq!(lab.core.abort_reason(), Some("smoke"));
    assert!(!lab.request(Service::AbortExperiment, "").success);
    lab.run(9.5);
    assert!(!lab.core.finished());
    lab.run(1.0);
    assert!(lab.core.finished());
}

/// Held in the middle of a turn: the references come to rest within their limits, the sequence stands still however long, and
/// goes on to its end once it is started again.
#[test]
fn an_experiment_is_held_where_it_is_and_goes_on_by_service() {
    let mut lab = Laboratory::new(PAIR);
    assert!(!lab.request(Service::HoldExperiment, "").success, "nothing runs yet");
    lab.run_until(FormationState::PHASE_MANOEUVRE, 40.0);
    lab.run(2.0);
    let answer = lab.request(Service::HoldExperiment, "a cable hangs");
    assert!(answer.success, "{}", answer.message);
    lab.run(30.0);
    let rate = |lab: &Laboratory| {
        let latest = lab.references.iter().map(|of| of.last().unwrap().omega_wr_r_rad_s);
        latest.map(|r: whorl_msgs::geometry_msgs::Vector3| r.x.hypot(r.y).hypot(r.z)).fold(0.0, f64::max)
    };
    assert!(rate(&lab) < 1e-6, "the references rest: {} rad/s", rate(&lab));
    let held = lab.states.last().unwrap().clone();
    lab.run(60.0);
    let later = lab.states.last().unwrap();
    assert_eq!((later.phase, &later.step), (held.phase, &held.step));
    assert!((later.step_elapsed_s - held.step_elapsed_s).abs() < 1e-9, "{held:?} {later:?}");
    assert_eq!(
        lab.commands.last().unwrap().command,
        FormationCommand::COMMAND_TRACK,
        "it keeps its authority"
    );
    assert!(lab.request(Service::StartExperiment, "").success);
    assert!(!lab.request(Service::StartExperiment, "").success, "it runs again");
    lab.run_until(FormationState::PHASE_FINISHED, 80.0);
}

#[test]
fn an_experiment_can_be_started_again_when_the_node_stays() {
    let stays = PAIR.replace("name: pair", "name: pair, exit_when_finished: false, at_end: hold");
    let mut lab = Laboratory::new(&stays);
    lab.run_until(FormationState::PHASE_FINISHED, 40.0);
    lab.run(5.0);
    assert!(!lab.core.finished());
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_HOLD);
    let last = lab.references[0].last().unwrap().clone();
    assert_eq!(last.mode, AttitudeReference::MODE_HOLD);
    assert!(lab.now.seconds_since(last.header.stamp.into()) < 0.03, "it is still published");
    assert!(lab.request(Service::StartExperiment, "").success);
    lab.run_until(FormationState::PHASE_SETTLE, 0.1);
    lab.run_until(FormationState::PHASE_FINISHED, 40.0);
}

#[test]
fn the_shutdown_commands_a_safe_state() {
    let mut lab = Laboratory::new(PAIR);
    lab.run(10.0);
    lab.deliver(Event::Shutdown);
    assert_eq!(lab.commands.last().unwrap().command, FormationCommand::COMMAND_ABORT);
    assert_eq!(lab.state().phase, FormationState::PHASE_ABORTED);
    let mut idle = Laboratory::new(PAIR);
    idle.deliver(Event::Shutdown);
    assert_eq!(idle.commands.last().unwrap().command, FormationCommand::COMMAND_STANDBY);
}

#[test]
fn an_offset_step_and_a_scan_move_who_they_should() {
    let experiment = PAIR.replace(
        "      hold: {kind: hold, duration_s: 5.0}",
        "      offset: {kind: offset, platform: whorl_2, yaw_deg: 30.0, duration_s: 20.0}
      scan: {kind: scan, axis: yaw, amplitude_deg: 4.0, period_s: 30.0, duration_s: 90.0}
      hold: {kind: hold, duration_s: 5.0}",
    );
    let mut lab = Laboratory::new(&experiment);
    lab.run(1.1 + 12.0 + 15.0);
    let leader = lab.platforms[0].q_world_body;
    lab.run(19.9);
    assert!(attitude_error(&leader, &lab.platforms[0].q_world_body).norm() < 2e-5, "the leader stood");
    assert!((lab.relative_yaw_deg() - 30.0).abs() < 0.02, "{}", lab.relative_yaw_deg());
    let (mut low, mut high, mut worst) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
    let centre = YawPitchRoll::of(&leader).yaw_rad;
    for _ in 0..9000 {
        lab.step();
        let yaw = (YawPitchRoll::of(&lab.platforms[0].q_world_body).yaw_rad - centre).to_degrees();
        (low, high) = (low.min(yaw), high.max(yaw));
        worst = worst.max(Vector3::from(lab.state().relative_error_rad[1]).norm());
    }
    assert!((low + 4.0).abs() < 0.02 && (high - 4.0).abs() < 0.02, "{low} {high}");
    assert!(worst.to_degrees() < 0.02, "the follower keeps up: {}", worst.to_degrees());
}

#[test]
fn the_virtual_structure_takes_both_along() {
    let experiment = PAIR
        .replace("    law:\n", "    law:\n      kind: virtual_structure\n")
        .replace("duration_s: 15.0", "duration_s: 40.0");
    let mut lab = Laboratory::new(&experiment);
    lab.run_until(FormationState::PHASE_HOLD, 70.0);
    lab.run(2.0);
    let state = lab.state();
    assert_eq!(state.law, "virtual_structure");
    assert_eq!(state.leader, [-1, 0]);
    assert!(Vector3::from(state.relative_error_rad[1]).norm() < 1e-3);
    assert!((lab.relative_yaw_deg() - 20.0).abs() < 0.05);
    let turned = YawPitchRoll::of(&lab.platforms[0].q_world_body).yaw_rad - 0.3;
    assert!((turned.to_degrees() - 10.0).abs() < 0.05, "{}", turned.to_degrees());
    for references in &lab.references {
        smoothness(references).check();
    }
}

#[test]
fn the_state_says_what_is_commanded_relative_to_whom() {
    let mut lab = Laboratory::new(PAIR);
    lab.run_until(FormationState::PHASE_MANOEUVRE, 20.0);
    lab.run(1.0);
    let state = lab.state();
    assert_eq!(state.leader, [-1, 0]);
    let own = state.q_leader_platform[0].to_unit().unwrap();
    let reference = reference_of(lab.references[0].last().unwrap()).q_world_reference;
    assert!(attitude_error(&own, &reference).norm() < 1e-2);
    let offset = YawPitchRoll::of(&state.q_leader_platform[1].to_unit().unwrap());
    assert!((offset.yaw_rad.to_degrees() - 20.0).abs() < 1e-9);
    assert_eq!(state.platforms, ["whorl_1", "whorl_2"]);
    assert_eq!(state.link_ok, [true, true]);
    assert_eq!(state.control_mode, [ControlStatus::MODE_TRACK; 2]);
}

#[test]
fn demands_beyond_the_tilt_limit_are_clipped_and_reported() {
    let mut lab = Laboratory::new(&PAIR.replace("pitch_deg: 1.0", "pitch_deg: 9.0"));
    lab.run_until(FormationState::PHASE_HOLD, 40.0);
    let mut highest = 0.0_f64;
    for message in &lab.references[0] {
        highest = highest.max(whorl_math::tilt_rad(&message.q_world_reference.to_unit().unwrap()));
    }
    assert!((highest.to_degrees() - 4.0).abs() < 0.01, "{}", highest.to_degrees());

    let mut lab = Laboratory::new(&PAIR.replace("offset: {yaw_deg: 20.0}", "offset: {pitch_deg: 40.0}"));
    lab.run(1.0 + 12.0 + 14.0);
    assert_eq!(lab.state().reference_clipped, [false, true]);
    let pitch = YawPitchRoll::of(&lab.platforms[1].q_world_body).pitch_rad.to_degrees();
    assert!((pitch - 29.0).abs() < 0.2, "{pitch}");
}

#[test]
fn the_same_events_give_the_same_bits() {
    let (mut one, mut two) = (Laboratory::new(PAIR), Laboratory::new(PAIR));
    one.run(25.0);
    two.run(25.0);
    assert_eq!(one.references, two.references);
    assert_eq!(one.commands, two.commands);
    // NaN is not equal to itself: compare the text.
    assert_eq!(format!("{:?}", one.states), format!("{:?}", two.states));
}

#[test]
fn limits_can_be_changed_while_running_but_not_the_experiment() {
    let mut lab = Laboratory::new(PAIR);
    lab.run(18.0);
    let slower = PAIR.replace("limits:\n", "limits:\n      whorl_1: {rate_max_deg_s: 0.5}\n");
    lab.core.reconfigure(&read(&slower).unwrap()).unwrap();
    lab.run(3.0);
    let rate = reference_of(lab.references[0].last().unwrap()).omega_wr_r_rad_s.norm();
    assert!(rate.to_degrees() < 0.51 && rate.to_degrees() > 0.4, "{}", rate.to_degrees());
    let another = PAIR.replace("duration_s: 5.0", "duration_s: 6.0");
    let refused = lab.core.reconfigure(&read(&another).unwrap()).unwrap_err();
    assert!(refused.contains("cannot be changed while it runs"), "{refused}");
}

#[test]
fn wrong_experiments_are_refused_with_the_place_and_what_is_allowed() {
    let structure = |gains: &str| {
        PAIR.replace(
            "    law:\n",
            &format!("    law:\n      kind: virtual_structure\n      virtual_structure: {{{gains}}}\n"),
        )
    };
    let cases = [
        (PAIR.replace("whorl_2: {offset", "whorl_3: {offset"), "`whorl_3` is no platform"),
        (PAIR.replace("{offset: {yaw_deg: 20.0}}", "{leader: whorl_2}"), "follow each other in a circle"),
        (PAIR.replace("{offset: {yaw_deg: 20.0}}", "{leader: whorl_9}"), "`whorl_9` is no platform"),
        (PAIR.replace("kind: hold", "kind: rest"), "test.yaml:13"),
        (PAIR.replace("duration_s: 5.0", "duration_s: -5.0"), "steps.hold.duration_s"),
        (PAIR.replace("yaw_deg: 10.0", "yaw_dg: 10.0"), "did you mean"),
        (PAIR.replace("tilt_max_deg: 30.0", "tilt_max_deg: 0.5"), "tilt_margin_deg"),
        (PAIR.split("    steps:").next().unwrap_or_default().to_owned(), "no steps"),
        (PAIR.replace("yaw_deg: 10.0", "platform: whorl_2, yaw_deg: 10.0"), "does not lead"),
        (structure("bandwidth_rad_s: 3.0"), "2.718"),
        (structure("damping: 0.5"), "damping"),
    ];
    for (experiment, expected) in cases {
        let error = read(&experiment).unwrap_err();
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

/// Where keys are exchanged, the first messages arrive before the last keys do.
#[test]
fn a_secured_formation_is_well_for_longer_before_it_starts() {
    let experiment = format!("{PAIR}    waiting: {{healthy_for_s: 1.0, healthy_for_secured_s: 4.0}}\n");
    let waits_s = |secured: bool| {
        let mut lab = Laboratory::new(&experiment);
        lab.core = CoordinatorCore::new(read(&experiment).unwrap()).unwrap().secured(secured);
        let begin = lab.now;
        lab.run_until(FormationState::PHASE_SETTLE, 20.0);
        lab.now.seconds_since(begin)
    };
    let (open_s, secured_s) = (waits_s(false), waits_s(true));
    assert!((secured_s - open_s - 3.0).abs() < 0.2, "open {open_s} s, secured {secured_s} s");
}
