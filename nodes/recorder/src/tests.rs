use whorl_bag::{BagError, BagOptions, RawSample, RunDescription, RunDirectory, RunWriter, SequenceCounts};
use whorl_msgs::diagnostic_msgs::DiagnosticStatus;
use whorl_msgs::{Message, Topic};
use whorl_node::{Event, NodeCore, Outputs, Timestamp};
use whorl_params::ParameterTree;

use super::*;

fn sample(tenths: i64, sequence: u64) -> RawSample<'static> {
    let log_time = Timestamp(1_790_000_000_000_000_000 + tenths * 100_000_000);
    RawSample { log_time, publish_time: log_time, origin: Some((1, sequence)), cdr: &[0, 1, 0, 0, 7] }
}

/// Refuses everything after `room` messages.
#[derive(Default)]
struct SmallSink {
    room: usize,
    names: Vec<String>,
    written: Vec<usize>,
    ticks: usize,
    stopped: Option<String>,
}

impl Sink for SmallSink {
    type Handle = usize;

    fn add_topic(&mut self, topic: &RecordedTopic) -> Result<usize, BagError> {
        self.names.push(topic.name.clone());
        Ok(self.names.len() - 1)
    }

    fn write(&mut self, topic: usize, _: RawSample<'_>) -> Result<(), BagError> {
        if self.stopped.is_some() {
            return Err(BagError::Stopped { path: "x".into() });
        }
        self.written.push(topic);
        if self.written.len() >= self.room {
            self.stopped = Some("full".into());
            return Err(BagError::DiskFull { path: "x".into(), bytes_kept: 1 });
        }
        Ok(())
    }

    fn tick(&mut self, _: Timestamp) -> Result<(), BagError> {
        self.ticks += 1;
        Ok(())
    }

    fn stopped_by(&self) -> Option<&str> {
        self.stopped.as_deref()
    }

    fn bytes_written(&self) -> u64 {
        42
    }

    fn sequence_counts(&self) -> SequenceCounts {
        SequenceCounts { lost: self.written.len() as u64 / 2, ..SequenceCounts::default() }
    }
}

#[test]
fn every_topic_of_every_platform_is_recorded() {
    let topics = RecordedTopic::all_of(&["whorl_1", "whorl_2"]);
    let per_platform = Topic::ALL.iter().filter(|t| t.info().per_platform).count();
    assert_eq!(topics.len(), 2 * per_platform + (Topic::ALL.len() - per_platform));
    let names: Vec<&str> = topics.iter().map(|t| t.name.as_str()).collect();
    assert!(names.contains(&"/whorl_2/imu/data_raw") && names.contains(&"/tf"));
    let mut sorted = names.clone();
    sorted.sort_unstable();
    sorted.dedup();
    assert_eq!(sorted.len(), names.len());
}

#[test]
fn a_full_sink_stops_the_recording_and_nothing_else() {
    let topics = RecordedTopic::all_of(&["a"]);
    let mut core = RecorderCore::new(SmallSink { room: 3, ..SmallSink::default() }, topics).unwrap();
    for i in 0..5 {
        core.sample(1, sample(i, i as u64));
        core.tick(sample(i, 0).log_time);
    }
    core.sample(999, sample(9, 9));
    let status = core.status();
    assert_eq!((status.recorded, status.refused), (3, 3));
    assert_eq!(status.stopped_by.as_deref(), Some("full"));
    assert_eq!(status.last_refusal.as_deref(), Some("topic number 999 was not added to this recording"));
    assert_eq!(status.last_sample, Some(sample(9, 9).log_time));
    let sink = core.finish();
    assert_eq!((sink.written, sink.ticks), (vec![1, 1, 1], 2));
}

#[test]
fn what_is_recorded_is_what_arrived() {
    let directory = tempfile::tempdir().unwrap();
    let description = RunDescription { platforms: vec!["a".into()], ..RunDescription::default() };
    let run = RunWriter::create(directory.path(), description, Timestamp(0), BagOptions::default()).unwrap();
    let path = run.path().to_owned();
    let mut topics = RecordedTopic::all_of(&["a"]);
    topics.push(RecordedTopic::parse("/rosout rcl_interfaces/msg/Log").unwrap());
    let last = topics.len() - 1;
    let mut core = RecorderCore::new(run, topics).unwrap();
    core.sample(0, sample(0, 1));
    core.sample(last, sample(1, 2));
    core.sample(0, sample(2, 4));
    assert_eq!((core.status().recorded, core.status().sequence_counts.lost), (3, 2));
    core.finish().finish(Timestamp(1)).unwrap();
    let bag = RunDirectory::open(&path).unwrap().bag().unwrap();
    let messages: Vec<_> = bag.messages().map(Result::unwrap).collect();
    let found: Vec<_> =
        messages.iter().map(|m| (m.topic.name.as_str(), m.sequence, m.cdr.as_slice())).collect();
    let cdr = [0, 1, 0, 0, 7].as_slice();
    assert_eq!(found, [("/a/imu/data_raw", 1, cdr), ("/rosout", 2, cdr), ("/a/imu/data_raw", 4, cdr)]);
    assert_eq!(messages[1].topic.type_name, "rcl_interfaces/msg/Log");
}

#[test]
fn diagnostics_tell_losses_silence_and_a_full_disk() {
    let mut statuses = [
        Status { recorded: 5, last_sample: Some(Timestamp(1_000_000_000)), ..Status::default() },
        Status { recorded: 105, last_sample: Some(Timestamp(2_000_000_000)), ..Status::default() },
        Status {
            recorded: 205,
            last_sample: Some(Timestamp(3_000_000_000)),
            sequence_counts: SequenceCounts { lost: 2, ..SequenceCounts::default() },
            ..Status::default()
        },
        Status {
            recorded: 205,
            last_sample: Some(Timestamp(0)),
            sequence_counts: SequenceCounts { lost: 2, ..SequenceCounts::default() },
            ..Status::default()
        },
        Status { recorded: 205, stopped_by: Some("no space left".into()), ..Status::default() },
        Status { recorded: 205, stopped_by: Some("no space left".into()), ..Status::default() },
    ]
    .into_iter();
    let mut core = ReportingCore::new("runs/x", move || statuses.next().unwrap());
    let mut logs = Vec::new();
    let mut seen = Vec::new();
    for second in 1..=6 {
        let mut outputs = Outputs::default();
        core.step(Timestamp(second * 1_000_000_000), Event::Timer, &mut outputs);
        logs.extend(outputs.log);
        let Message::DiagnosticArray(array) = &*outputs.messages[0].message else { panic!() };
        seen.push((array.status[0].level, array.status[0].message.clone()));
        assert_eq!(array.status[0].values[0].value, "runs/x");
    }
    let expected = [
        (DiagnosticStatus::OK, "recording 5 messages per second"),
        (DiagnosticStatus::OK, "recording 100 messages per second"),
        (DiagnosticStatus::WARN, "2 messages lost in the last second"),
        (DiagnosticStatus::WARN, "no messages"),
        (DiagnosticStatus::ERROR, "recording stopped: no space left"),
        (DiagnosticStatus::ERROR, "recording stopped: no space left"),
    ];
    assert_eq!(seen, expected.map(|(level, text)| (level, text.to_owned())));
    assert_eq!(logs.len(), 1);
}

#[test]
fn parameters_have_defaults_and_wrong_ones_are_refused() {
    let read = |own: &str| {
        let file = format!(
            "/**:\n  ros__parameters:\n    formation: {{platforms: [a]}}\n/recorder:\n  ros__parameters:\n    {own}\n"
        );
        let tree = ParameterTree::from_texts(&[("p.yaml", &file)], &[]).unwrap();
        whorl_params::try_read(&tree.for_node("/recorder"), parameters::read).map(|(p, _)| p)
    };
    let parameters = read("extra_topics: [/rosout rcl_interfaces/msg/Log]").unwrap();
    assert_eq!(parameters.out_directory.to_str(), Some("runs"));
    let ten_minutes = Some(std::time::Duration::from_secs(600));
    assert_eq!(parameters.bag, BagOptions { max_file_age: ten_minutes, ..BagOptions::default() });
    assert_eq!(parameters.extra_topics[0].name, "/rosout");
    let error = read("extra_topics: [rosout Log]").unwrap_err().to_string();
    assert!(error.contains("p.yaml:6") && error.contains("/TOPIC PACKAGE/msg/TYPE"), "{error}");
    let error = read("max_chunk_age_s: 2.0").unwrap_err().to_string();
    assert!(error.contains("from 0.05 to 1"), "{error}");
    let error = read("max_file_age_s: 0.5").unwrap_err().to_string();
    assert!(error.contains("p.yaml:6") && error.contains("from 1 to 86400"), "{error}");
}
