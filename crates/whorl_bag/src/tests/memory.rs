//! What recording for hours costs in memory.

use std::time::Duration;

use allocation_counter::measure;
use whorl_msgs::{PlatformId, Route, Topic};
use whorl_node::Timestamp;

use crate::{BagOptions, RawSample, RunDescription, RunWriter};

/// Topics of a platform that are recorded; each comes once in every chunk, so that each is in every chunk's index.
const TOPICS: [Topic; 8] = [
    Topic::ImuRaw,
    Topic::AttitudeEstimate,
    Topic::ControlStatus,
    Topic::ActuatorCommand,
    Topic::AttitudeReference,
    Topic::GateState,
    Topic::WheelState,
    Topic::TruthState,
];
const BEGAN_S: f64 = 1_790_000_000.0;

/// Records each hour as fast as it can; how much more is held after it than before \[bytes\].
fn grown(options: BagOptions, hours: u32) -> Vec<i64> {
    let folder = tempfile::tempdir().unwrap();
    let description = RunDescription { platforms: vec!["whorl_1".into()], ..RunDescription::default() };
    let began = Timestamp::from_seconds(BEGAN_S);
    let mut run = RunWriter::create(folder.path(), description, began, options).unwrap();
    let topics: Vec<_> =
        TOPICS.iter().map(|topic| run.add_route(Route::platform(PlatformId(0), *topic)).unwrap()).collect();
    // Contents are of no concern: an empty message.
    let cdr = [0, 1, 0, 0, 0, 0, 0, 0];
    let mut tick = 0u32;
    let mut hour = || {
        measure(|| {
            for _ in 0..7200 {
                let now = began + Duration::from_millis(500) * tick;
                for (topic, writer) in topics.iter().zip(0..) {
                    let origin = Some((writer, u64::from(tick)));
                    let sample = RawSample { log_time: now, publish_time: now, origin, cdr: &cdr };
                    run.write_raw(*topic, sample).unwrap();
                }
                run.tick(now).unwrap();
                tick += 1;
            }
        })
        .bytes_current
    };
    (0..hours).map(|_| hour()).collect()
}

/// With the recorder's files of ten minutes memory is as large after a day as after an hour but for the list of files; with one file
/// it grows by the index of each chunk.
#[test]
fn what_a_recorder_holds_does_not_grow_with_the_hours() {
    let ten_minutes = BagOptions { max_file_age: Some(Duration::from_secs(600)), ..BagOptions::default() };
    // The first hour fills buffers.
    let kept: Vec<i64> = grown(ten_minutes, 10).split_off(1);
    assert!(kept.iter().all(|bytes| *bytes < 50_000), "{kept:?}");
    let one_file = grown(BagOptions::default(), 3);
    assert!(one_file[1] > 500_000, "the test would not notice: {one_file:?}");
}
