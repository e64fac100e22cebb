//! A coordinator that ends in the middle of an experiment and is started again.

use super::*;
use whorl_msgs::topics::Service;

/// A formation whose coordinator has run for so long, and what was kept of that.
fn interrupted(experiment: &str, after_s: f64) -> (Laboratory, String) {
    let mut laboratory = Laboratory::new(experiment);
    laboratory.run(after_s);
    let kept = laboratory.core.progress(laboratory.now).unwrap();
    (laboratory, kept)
}

/// The coordinator ends; another is started `away_s` later with what was kept.
fn start_again(laboratory: &mut Laboratory, experiment: &str, kept: &str, away_s: f64) {
    laboratory.now = Timestamp(laboratory.now.0 + (away_s * 1e9) as i64);
    laboratory.core =
        CoordinatorCore::new(read(experiment).unwrap()).unwrap().going_on(kept.to_owned(), away_s);
    laboratory.states.clear();
    laboratory.commands.clear();
    laboratory.log.clear();
    laboratory.references.iter_mut().for_each(Vec::clear);
}

/// Nobody was given authority, and no reference was sent.
fn nothing_moved(laboratory: &Laboratory) -> bool {
    laboratory.references.iter().all(Vec::is_empty)
        && laboratory.commands.iter().all(|c| c.command == FormationCommand::COMMAND_STANDBY)
}

#[test]
fn it_goes_on_where_it_was_and_ends_where_it_would_have() {
    // In the settle, early and late in the slew, and in the hold.
    for after_s in [4.0, 16.0, 22.0, 31.0] {
        let (mut laboratory, kept) = interrupted(PAIR, after_s);
        let before = laboratory.state().clone();
        start_again(&mut laboratory, PAIR, &kept, 7.0);
        laboratory.run_until(FormationState::PHASE_FINISHED, 60.0);
        laboratory.check_end();
        assert!(laboratory.log.iter().any(|line| line.contains("goes on after")), "{:?}", laboratory.log);
        let running = laboratory.states.iter().filter(|s| s.phase >= FormationState::PHASE_SETTLE);
        let first = running.clone().next().unwrap();
        // No step is begun anew, and the time without a coordinator is counted as waiting.
        assert_eq!(first.step.trim_end_matches(" (waiting)"), before.step.trim_end_matches(" (waiting)"));
        assert!(first.step_elapsed_s >= before.step_elapsed_s, "{first:?}");
        assert!(first.run_elapsed_s > before.run_elapsed_s + 7.0, "{first:?}");
        let planned_s = 12.0 + 15.0 + 5.0;
        assert!(first.run_length_s >= planned_s + 7.0, "{first:?}");
        laboratory.references.iter().for_each(|references| smoothness(references).check());
    }
}

#[test]
fn angles_of_later_steps_count_from_the_first_start() {
    // The leader is carried away meanwhile: its yaw is counted from where the experiment began all the same.
    let (mut laboratory, kept) = interrupted(PAIR, 5.0);
    laboratory.platforms[0].q_world_body =
        YawPitchRoll { yaw_rad: START_YAW_RAD + 0.2, pitch_rad: 0.01, roll_rad: 0.02 }.attitude();
    start_again(&mut laboratory, PAIR, &kept, 1.0);
    laboratory.run_until(FormationState::PHASE_FINISHED, 60.0);
    laboratory.check_end();
}

#[test]
fn what_was_held_is_held_until_somebody_starts_it() {
    let (mut laboratory, _) = interrupted(PAIR, 16.0);
    assert!(laboratory.request(Service::HoldExperiment, "a cable\nhangs").success);
    laboratory.run(1.0);
    let kept = laboratory.core.progress(laboratory.now).unwrap();
    start_again(&mut laboratory, PAIR, &kept, 7.0);
    laboratory.run(30.0);
    assert!(laboratory.state().step.contains("(waiting)"), "{:?}", laboratory.state());
    assert!(laboratory.request(Service::StartExperiment, "").success);
    laboratory.run_until(FormationState::PHASE_FINISHED, 40.0);
    laboratory.check_end();

    // A person is faster than the platforms.
    let (mut laboratory, kept) = interrupted(PAIR, 16.0);
    start_again(&mut laboratory, PAIR, &kept, 7.0);
    laboratory.step();
    assert!(laboratory.request(Service::HoldExperiment, "").success);
    laboratory.run(30.0);
    assert!(laboratory.state().step.contains("(waiting)"), "{:?}", laboratory.state());
    let (mut laboratory, kept) = interrupted(PAIR, 16.0);
    start_again(&mut laboratory, PAIR, &kept, 7.0);
    laboratory.step();
    assert!(laboratory.request(Service::AbortExperiment, "").success);
    laboratory.run(30.0);
    assert!(nothing_moved(&laboratory));
}

#[test]
fn what_is_old_or_unreadable_or_of_another_experiment_moves_nothing() {
    let (laboratory, kept) = interrupted(PAIR, 16.0);
    let longer = PAIR.replace("duration_s: 5.0", "duration_s: 6.0");
    let cases = [
        (PAIR, kept.clone(), 301.0, "without a coordinator for 301 s"),
        (PAIR, kept.clone(), f64::NAN, "without a coordinator"),
        (PAIR, String::new(), 1.0, "cannot be read"),
        (PAIR, kept[..kept.len() / 2].to_owned(), 1.0, "cannot be read"),
        (PAIR, kept.replace("step 1\n", "step 9\n"), 1.0, "cannot be read (step)"),
        (PAIR, kept.replace("step_elapsed_s", "step_elapsed_s NaN"), 1.0, "cannot be read"),
        (PAIR, kept.replacen("start ", "start 9", 1), 1.0, "cannot be read (start)"),
        (&longer, kept.clone(), 1.0, "another experiment"),
    ];
    for (experiment, kept, age_s, why) in cases {
        let mut again = Laboratory::new(experiment);
        again.platforms.clone_from(&laboratory.platforms);
        again.core = CoordinatorCore::new(read(experiment).unwrap()).unwrap().going_on(kept, age_s);
        again.run(20.0);
        assert!(nothing_moved(&again), "{why}");
        assert!(
            again.core.abort_reason().is_some_and(|reason| reason.contains(why)),
            "{why}: {:?}",
            again.log
        );
        assert_eq!(again.core.progress(again.now), None, "what was kept stays");
    }
}

#[test]
fn what_was_aborted_stays_so_and_what_has_finished_is_not_repeated() {
    let (mut laboratory, _) = interrupted(PAIR, 16.0);
    laboratory.request(Service::AbortExperiment, "smoke");
    let kept = laboratory.core.progress(laboratory.now).unwrap();
    start_again(&mut laboratory, PAIR, &kept, 1.0);
    laboratory.run(20.0);
    assert!(nothing_moved(&laboratory));
    assert_eq!(laboratory.core.abort_reason(), Some("smoke"));

    let mut laboratory = Laboratory::new(PAIR);
    laboratory.run_until(FormationState::PHASE_FINISHED, 60.0);
    let kept = laboratory.core.progress(laboratory.now).unwrap();
    start_again(&mut laboratory, PAIR, &kept, 1.0);
    laboratory.run_until(FormationState::PHASE_FINISHED, 10.0);
    laboratory.check_end();
}

#[test]
fn platforms_that_are_not_well_in_time_do_not_move_afterwards() {
    let (mut laboratory, kept) = interrupted(PAIR, 16.0);
    laboratory.platforms[1].cut = true;
    start_again(&mut laboratory, PAIR, &kept, 280.0);
    laboratory.run(19.0);
    assert_eq!(laboratory.core.abort_reason(), None);
    laboratory.run(2.0);
    assert!(laboratory.core.abort_reason().is_some_and(|why| why.contains("without a coordinator")));
    laboratory.platforms[1].cut = false;
    laboratory.run(20.0);
    assert!(nothing_moved(&laboratory));
}

#[test]
fn nothing_is_kept_of_what_has_not_begun() {
    let mut laboratory = Laboratory::new(PAIR);
    laboratory.platforms[1].cut = true;
    laboratory.run(5.0);
    assert_eq!(laboratory.core.progress(laboratory.now), None);
}
