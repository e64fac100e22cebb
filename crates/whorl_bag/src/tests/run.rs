//! Run directories.

use std::sync::Arc;

use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{PlatformId, Route, Topic, sensor_msgs};
use whorl_node::Timestamp;

use super::time;
use crate::{
    BagError, BagOptions, RawSample, RunDescription, RunDirectory, RunState, RunWriter, SequenceCounts,
    recover_runs,
};

const START: Timestamp = Timestamp(1_790_000_000_000_000_000);

fn description() -> RunDescription {
    RunDescription {
        experiment: "leader follower".into(),
        version: "0.1.0".into(),
        platforms: vec!["whorl_1".into(), "whorl_2".into()],
        seed: Some(3),
        ..RunDescription::default()
    }
}

/// 100 Hz for two seconds; numbers 50 to 52 are lost.
fn record(run: &mut RunWriter) {
    for sequence in (0..200).filter(|s| !(50..53).contains(s)) {
        let estimate = AttitudeEstimate { sequence, ..AttitudeEstimate::default() };
        let route = Route::platform(PlatformId(1), Topic::AttitudeEstimate);
        run.write_message(route, time(sequence), &estimate.into()).unwrap();
        let imu = sensor_msgs::Imu::default();
        run.write_message(Route::platform(PlatformId(0), Topic::ImuRaw), time(sequence), &imu.into())
            .unwrap();
    }
}

#[test]
fn a_run_has_everything_and_counts_its_losses() {
    let directory = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(directory.path().join("p/truth")).unwrap();
    let [common, truth, other] = ["p/common.yaml", "p/truth/a.yaml", "common.yaml"].map(|name| {
        let path = directory.path().join(name);
        std::fs::write(&path, "abc").unwrap();
        path
    });
    let runs = directory.path().join("runs");
    let mut run = RunWriter::create(&runs, description(), START, BagOptions::default()).unwrap();
    assert_eq!(run.path().file_name().unwrap(), "2026-09-21T14-13-20Z_leader_follower");
    for file in [common, truth, other] {
        run.add_parameter_file(&file).unwrap();
    }
    run.add_parameters("effective.yaml", "all layers", b"x: 1\n").unwrap();
    record(&mut run);
    let unknown = Route::platform(PlatformId(2), Topic::ImuRaw);
    let result = run.write_message(unknown, time(0), &sensor_msgs::Imu::default().into());
    assert!(matches!(result, Err(BagError::UnknownPlatform { platform: 2, count: 2 })));
    let path = run.path().to_owned();
    let written = run.finish(Timestamp(START.0 + 2_000_000_000)).unwrap();

    let run = RunDirectory::open(&path).unwrap();
    let manifest = run.manifest().unwrap();
    assert_eq!(manifest, &written);
    assert_eq!(manifest.state, RunState::Complete);
    assert_eq!((manifest.message_count(), manifest.lost()), (2 * 197, 3));
    assert_eq!(manifest.bounds, Some((time(0), time(199))));
    let estimate = manifest.topic("/whorl_2/attitude/estimate").unwrap();
    assert_eq!(
        estimate.sequence,
        Some(SequenceCounts { received: 197, lost: 3, ..SequenceCounts::default() })
    );
    assert!((estimate.largest_gap_s - 0.04).abs() < 1e-9 && (estimate.largest_gap_at_s - 0.49).abs() < 1e-9);
    assert_eq!(estimate.gaps, 1);
    assert_eq!(manifest.topic("/whorl_1/imu/data_raw").unwrap().sequence, None);
    // echo -n abc | sha256sum
    assert_eq!(
        manifest.parameters[0].sha256,
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    );
    let files: Vec<_> = manifest.parameters.iter().map(|p| p.file.as_str()).collect();
    assert_eq!(
        files,
        ["params/common.yaml", "params/truth/a.yaml", "params/2_common.yaml", "params/effective.yaml"]
    );
    assert!(run.parameter_files().iter().all(|file| file.exists()));
    assert_eq!(manifest.bag_bytes, std::fs::metadata(path.join("bag/bag_0.mcap")).unwrap().len());
    assert!(!path.join("bag/.reserve").exists());
    assert_eq!(run.platforms().unwrap(), ["whorl_1", "whorl_2"]);
    assert_eq!(run.bag().unwrap().message_count(), 394);

    let entry = serde_json::json!({"pointing_rms_deg": 0.04});
    run.update_summary(entry.as_object().unwrap()).unwrap();
    let summary = run.summary().unwrap();
    assert_eq!((summary["lost"].as_u64(), summary["pointing_rms_deg"].as_f64()), (Some(3), Some(0.04)));
    // Another one of the same second.
    let second = RunWriter::create(&runs, description(), START, BagOptions::default()).unwrap();
    assert_eq!(second.path().file_name().unwrap(), "2026-09-21T14-13-20Z_leader_follower_2");
}

#[test]
fn a_killed_run_is_made_complete_with_the_same_counts() {
    let directory = tempfile::tempdir().unwrap();
    let mut run = RunWriter::create(directory.path(), description(), START, BagOptions::default()).unwrap();
    record(&mut run);
    let path = run.path().to_owned();
    // Half a second later by the clock everything has been written; then the process dies.
    run.tick(Timestamp(0)).unwrap();
    run.tick(Timestamp(500_000_000)).unwrap();
    let killed = directory.path().join("killed");
    copy(&path, &killed);
    let written = run.finish(START).unwrap();

    let again = directory.path().join("killed too");
    copy(&killed, &again);
    let mut run = RunDirectory::open(&killed).unwrap();
    assert_eq!(run.manifest().unwrap().state, RunState::Recording);
    let without_change = run.manifest_or_from_bag().unwrap();
    assert!(killed.join("bag/.reserve").exists());
    let recovery = run.recover().unwrap();
    assert_eq!((recovery.files, recovery.messages), (1, 394));
    let manifest = run.manifest().unwrap();
    assert_eq!(manifest.state, RunState::Recovered);
    assert_eq!(manifest.topics, without_change.topics);
    for (found, expected) in manifest.topics.iter().zip(&written.topics) {
        assert_eq!((&found.name, found.count, found.bytes), (&expected.name, expected.count, expected.bytes));
        assert_eq!(found.largest_gap_s, expected.largest_gap_s);
    }
    assert_eq!(manifest.lost(), written.lost());
    assert!(run.bag().unwrap().integrity().complete && !killed.join("bag/.reserve").exists());
    assert_eq!(RunDirectory::open(&killed).unwrap(), run);
    assert_eq!(run.recover().unwrap().files, 0);

    // All of a directory: the one that is being recorded and the complete ones stay as they are.
    let going_on = RunWriter::create(directory.path(), description(), START, BagOptions::default()).unwrap();
    let found = recover_runs(directory.path());
    assert_eq!(found.len(), 1);
    assert_eq!((&found[0].0, found[0].1.as_ref().unwrap().messages), (&again, 394));
    assert_eq!(RunDirectory::open(going_on.path()).unwrap().manifest().unwrap().state, RunState::Recording);
}

#[test]
fn a_plain_bag_is_a_run_without_a_manifest() {
    let directory = tempfile::tempdir().unwrap();
    let mut run = RunWriter::create(directory.path(), description(), START, BagOptions::default()).unwrap();
    record(&mut run);
    let bag = run.path().join("bag");
    run.finish(START).unwrap();
    for path in [bag.clone(), bag.join("bag_0.mcap")] {
        let run = RunDirectory::open(&path).unwrap();
        assert_eq!(run.manifest(), None);
        assert_eq!(run.platforms().unwrap(), ["whorl_1", "whorl_2"]);
        assert_eq!(run.manifest_or_from_bag().unwrap().message_count(), 394);
    }
    assert!(matches!(RunDirectory::open(&directory.path().join("no")), Err(BagError::NotFound { .. })));
    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(RunDirectory::open(empty.path()), Err(BagError::NotABag { .. })));
}

#[test]
fn a_given_directory_may_hold_logs_but_no_run() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a/b");
    std::fs::create_dir_all(path.join("logs")).unwrap();
    let create = || RunWriter::create_in(&path, description(), START, BagOptions::default());
    let run = create().unwrap();
    assert!(matches!(create(), Err(BagError::Exists { .. })));
    run.finish(START).unwrap();
    assert_eq!(RunDirectory::open(&path).unwrap().manifest().unwrap().message_count(), 0);
}

#[test]
fn writers_are_counted_apart() {
    let directory = tempfile::tempdir().unwrap();
    let mut run = RunWriter::create(directory.path(), description(), START, BagOptions::default()).unwrap();
    let topic = run.add_route(Route::shared(Topic::Diagnostics)).unwrap();
    for (i, (writer, sequence)) in [(1, 1), (2, 7), (1, 2), (2, 9), (1, 3)].into_iter().enumerate() {
        let at = time(i as u64);
        let origin = Some((writer, sequence));
        run.write_raw(topic, RawSample { log_time: at, publish_time: at, origin, cdr: &[0, 1, 0, 0] })
            .unwrap();
    }
    assert_eq!(run.sequence_counts().lost, 1);
    let manifest = run.finish(START).unwrap();
    assert_eq!(manifest.topic("/diagnostics").unwrap().writers, 2);
}

fn copy(from: &std::path::Path, to: &std::path::Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target)
        } else {
            drop(std::fs::copy(entry.path(), target))
        }
    }
}

#[test]
fn a_run_written_in_the_background_is_the_same_to_the_byte() {
    let directory = tempfile::tempdir().unwrap();
    let create = |name: &str| {
        RunWriter::create_in(&directory.path().join(name), description(), START, BagOptions::default())
            .unwrap()
    };
    let (mut foreground, mut background) = (create("a"), crate::BackgroundRunWriter::new(create("b")));
    let route = Route::platform(PlatformId(1), Topic::AttitudeEstimate);
    // More than one batch, and a rest.
    for sequence in 0..3000 {
        let message = Arc::new(AttitudeEstimate { sequence, ..AttitudeEstimate::default() }.into());
        foreground.write_message(route, time(sequence), &message).unwrap();
        background.write_message(route, time(sequence), &message).unwrap();
    }
    let manifests = [foreground.finish(START).unwrap(), background.finish(START).unwrap()];
    assert_eq!(manifests[0].topics, manifests[1].topics);
    let [a, b] =
        ["a", "b"].map(|name| std::fs::read(directory.path().join(name).join("bag/bag_0.mcap")).unwrap());
    assert!(a.len() > 3000 * 400 && a == b);
}

#[test]
fn the_reason_why_a_background_recording_stopped_is_told() {
    let directory = tempfile::tempdir().unwrap();
    let run =
        RunWriter::create_in(&directory.path().join("run"), description(), START, BagOptions::default());
    let mut run = crate::BackgroundRunWriter::new(run.unwrap());
    let unknown = Route::platform(PlatformId(2), Topic::ImuRaw);
    run.write_message(unknown, time(0), &Arc::new(sensor_msgs::Imu::default().into())).unwrap();
    assert!(matches!(run.finish(START), Err(BagError::UnknownPlatform { platform: 2, count: 2 })));
}
