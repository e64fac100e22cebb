//! Time to record one message: `cargo bench -p whorl_bag`.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use whorl_bag::{
    BagOptions, BagReader, BagWriter, Compression, RunDescription, RunWriter, Sample, TopicHandle,
};
use whorl_msgs::whorl::AttitudeEstimate;
use whorl_msgs::{Message, PlatformId, Route, Topic};
use whorl_node::Timestamp;

const COUNT: u64 = 10_000;

/// Estimates as a filter makes them: all numbers differ in all digits, so that they compress as real ones.
fn estimates() -> Vec<Message> {
    (0..COUNT)
        .map(|sequence| {
            let mut message = AttitudeEstimate { sequence, ..AttitudeEstimate::default() };
            message.header.frame_id = "whorl_1/base_link".into();
            for (i, entry) in message.covariance.iter_mut().enumerate() {
                *entry = ((sequence * 37 + i as u64) as f64).sin() * 1e-6;
            }
            message.into()
        })
        .collect()
}

fn time(sequence: u64) -> Timestamp {
    Timestamp(sequence as i64 * 10_000_000)
}

fn bag(directory: &std::path::Path, compression: Compression) -> (BagWriter, TopicHandle) {
    let options = BagOptions { compression, ..BagOptions::default() };
    let mut writer = BagWriter::create(directory, options).unwrap();
    let topic =
        writer.add_topic("/whorl_1/attitude/estimate", "whorl_msgs/msg/AttitudeEstimate", "").unwrap();
    (writer, topic)
}

fn write(c: &mut Criterion) {
    let mut group = c.benchmark_group("10000 messages");
    group.sample_size(20);
    let messages = estimates();
    let encoded: Vec<Vec<u8>> = messages
        .iter()
        .map(|message| {
            let mut bytes = Vec::new();
            message.encode_into(&mut bytes).unwrap();
            bytes
        })
        .collect();
    let fill = |(mut writer, topic): (BagWriter, TopicHandle)| {
        for (sequence, cdr) in encoded.iter().enumerate() {
            let at = time(sequence as u64);
            writer
                .write(topic, Sample { log_time: at, publish_time: at, sequence: sequence as u64, cdr })
                .unwrap();
        }
        writer.finish().unwrap()
    };
    for (name, compression) in [("uncompressed", Compression::None), ("lz4", Compression::Lz4)] {
        group.bench_function(format!("raw, {name}"), |b| {
            let directory = tempfile::tempdir().unwrap();
            let mut number = 0;
            b.iter_batched(
                || {
                    number += 1;
                    bag(&directory.path().join(number.to_string()), compression)
                },
                fill,
                BatchSize::PerIteration,
            );
        });
    }
    group.bench_function("encode only", |b| {
        let mut bytes = Vec::new();
        b.iter(|| {
            for message in &messages {
                message.encode_into(&mut bytes).unwrap();
                black_box(&bytes);
            }
        });
    });
    group.bench_function("encode, count, write", |b| {
        let directory = tempfile::tempdir().unwrap();
        let description = RunDescription { platforms: vec!["whorl_1".into()], ..RunDescription::default() };
        let route = Route::platform(PlatformId(0), Topic::AttitudeEstimate);
        b.iter_batched(
            || {
                RunWriter::create(directory.path(), description.clone(), Timestamp(0), BagOptions::default())
                    .unwrap()
            },
            |mut run| {
                for (sequence, message) in messages.iter().enumerate() {
                    run.write_message(route, time(sequence as u64), message).unwrap();
                }
                run.finish(Timestamp(0)).unwrap()
            },
            BatchSize::PerIteration,
        );
    });
    group.bench_function("read", |b| {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("bag");
        fill(bag(&path, Compression::None));
        let reader = BagReader::open(&path).unwrap();
        b.iter(|| reader.messages().map(|message| message.unwrap().cdr.len()).sum::<usize>());
    });
    group.finish();
}

criterion_group!(benches, write);
criterion_main!(benches);
