//! Cost of a simulated experiment: `cargo bench -p whorl_commands`. Twenty simulated seconds of two platforms, 1 kHz plant:
//! as `whorl simulate` does it, and with its parts left out.
#![allow(missing_docs, clippy::expect_used, reason = "a bench: criterion's macros, and a shipped experiment")]

use std::path::Path;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use whorl_commands::simulate::{Record, Simulation};
use whorl_node::Timestamp;

const WITHOUT_MONITOR: &str = "/**/model_monitor:enabled:=false";

fn simulation(record: Record, overrides: &[&str]) -> Simulation {
    let experiment =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../params/experiments/leader_follower.yaml");
    Simulation {
        experiment,
        record,
        seed: 1,
        params: None,
        overrides: overrides.iter().map(|text| (*text).to_owned()).collect(),
        longest_s: 20.0,
    }
}

fn simulate(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("20 simulated seconds, two platforms");
    group.sample_size(20);
    let carry_out = |simulation: Simulation| {
        simulation.run(false, || Timestamp(0), &mut |_| {}).expect("a shipped experiment")
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut number = 0;
    group.bench_function("all nodes, recorded", |b| {
        b.iter_batched(
            || {
                number += 1;
                simulation(Record::Into(folder.path().join(number.to_string())), &[])
            },
            carry_out,
            BatchSize::PerIteration,
        );
    });
    group.bench_function("all nodes", |b| {
        b.iter_batched(|| simulation(Record::Nothing, &[]), carry_out, BatchSize::PerIteration);
    });
    group.bench_function("without model monitors", |b| {
        b.iter_batched(
            || simulation(Record::Nothing, &[WITHOUT_MONITOR]),
            carry_out,
            BatchSize::PerIteration,
        );
    });
    group.finish();
}

criterion_group!(benches, simulate);
criterion_main!(benches);
