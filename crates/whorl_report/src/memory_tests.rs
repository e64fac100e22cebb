//! What a run of some length costs in memory.

use whorl_msgs::geometry_msgs::Quaternion;
use whorl_msgs::std_msgs::Header;
use whorl_msgs::topics::Message;
use whorl_msgs::whorl::{AttitudeEstimate, AttitudeReference, ControlStatus, FormationState, ThrusterState};
use whorl_node::Timestamp;

use crate::{Collector, RunData};

/// Two platforms at the rates of a real run, turning; whorl_2 lags by 0.01 rad and estimates 0.002 rad less.
fn run_of(seconds: u32, mut collector: Collector) -> RunData {
    let turn = |angle: f64| Quaternion { x: 0.0, y: 0.0, z: (angle / 2.0).sin(), w: (angle / 2.0).cos() };
    for tick in 0..seconds * 100 {
        let time_s = f64::from(tick) * 0.01;
        let now = Timestamp::from_seconds(100.0 + time_s);
        let header = Header { stamp: now.into(), frame_id: String::new() };
        let mut add = |topic: &str, message: Message| collector.add(topic, now.0, &message);
        let angle = (0.1 * time_s).sin();
        for (name, lag, error) in [("whorl_1", 0.0, 0.0), ("whorl_2", 0.01, 0.002)] {
            let at = |angle| AttitudeEstimate {
                header: header.clone(),
                q_world_body: turn(angle),
                health: AttitudeEstimate::HEALTH_OK,
                ..AttitudeEstimate::default()
            };
            add(&format!("/{name}/truth/state"), at(angle - lag).into());
            add(&format!("/{name}/attitude/estimate"), at(angle - lag - error).into());
            let total_on_time_s = vec![0.1 * time_s; 12];
            let thrusters = ThrusterState { header: header.clone(), total_on_time_s, ..Default::default() };
            add(&format!("/{name}/thrusters/state"), thrusters.into());
            if tick % 2 == 0 {
                let mode = ControlStatus::MODE_TRACK;
                let status = ControlStatus {
                    header: header.clone(),
                    mode,
                    estimate_age_s: 0.004,
                    ..Default::default()
                };
                add(&format!("/{name}/control/status"), status.into());
                let reference = AttitudeReference {
                    header: header.clone(),
                    q_world_reference: turn(angle),
                    ..Default::default()
                };
                add(&format!("/{name}/attitude/reference"), reference.into());
            }
        }
        if tick % 10 == 0 {
            let state = FormationState {
                header,
                phase: FormationState::PHASE_HOLD,
                run_elapsed_s: time_s + 0.01,
                platforms: vec!["whorl_1".to_owned(), "whorl_2".to_owned()],
                leader: vec![-1, 0],
                q_leader_platform: vec![turn(0.0); 2],
                ..FormationState::default()
            };
            add("/formation/state", state.into());
        }
    }
    collector.finish()
}

#[test]
fn the_memory_of_a_long_run_is_bounded_and_its_numbers_are_exact() {
    let mut runs = Vec::new();
    let mut peak_of = |seconds: u32| {
        let mut run = RunData::default();
        let counted = allocation_counter::measure(|| run = run_of(seconds, Collector::default()));
        runs.push(run);
        counted.bytes_max as f64 / 1e6
    };
    let (short_mb, long_mb) = (peak_of(300), peak_of(1200));
    let per_hour_mb = (long_mb - short_mb) * 3600.0 / 900.0;
    // What grows: ages and errors in hold, 8 bytes each, and the formation's states.
    assert!(short_mb < 60.0 && per_hour_mb < 60.0, "{short_mb:.1} MB, and {per_hour_mb:.1} MB an hour");
    for run in &runs {
        let summary = crate::summarise(run);
        let [pair] = summary.pairs.as_slice() else { panic!("{summary:?}") };
        let near = |found: f64, is: f64| assert!((found - is).abs() < 1e-9, "{found} for {is}");
        near(pair.relative_error_rms_rad, 0.01);
        near(pair.relative_error_max_rad, 0.01);
        near(pair.estimator_error_rms_rad, 0.002);
        near(pair.control_error_rms_rad, 0.012);
        assert!(pair.from_truth);
        near(pair.hold_s, run.duration_s - 0.09);
        let [first, second] = summary.platforms.as_slice() else { panic!("{summary:?}") };
        near(first.pointing_error_rms_rad, 0.0);
        near(second.pointing_error_rms_rad, 0.01);
        near(second.estimator_heading_error_rms_rad, 0.002);
        near(second.jet_on_time_s, 12.0 * 0.1 * run.duration_s);
        near(second.sensor_to_command_p99_s, 0.004);
        assert_eq!(second.not_tracking_s, 0.0);
    }
}

#[test]
fn numbers_are_the_same_without_curves_and_frames() {
    let [whole, bare] =
        [Collector::default(), Collector::for_numbers()].map(|collector| run_of(60, collector));
    // As text: what cannot be computed is not a number, which equals nothing.
    let numbers = |run: &RunData| format!("{:?}", crate::summarise(run));
    assert!(numbers(&whole).contains("hold_s: 59"));
    assert_eq!(numbers(&bare), numbers(&whole));
    let drawn = |run: &RunData| {
        let of = |p: &crate::platform::PlatformData| !p.frames.is_empty() || p.tilt.points().next().is_some();
        run.platforms.values().filter(|p| of(p)).count()
    };
    assert_eq!([drawn(&whole), drawn(&bare)], [2, 0]);
}
