//! How long a diagnosis of ten minutes at 100 Hz with every effect takes on two threads, and how much memory: of
//! the verdicts that take longest too.
//!
//! ```text
//! cargo bench -p whorl_challenge
//! ```

#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use whorl_challenge::cases::build::{Stand, stand_key};
use whorl_challenge::cases::{Laboratory, all_specs, build};
use whorl_identification::{Options, diagnose};

/// No missing effect; one torque; hidden states; sensors that contradict each other.
const CASES: [&str; 4] = [
    "control/none/0/0",
    "single/bearing_viscous_friction/100/0",
    "single/slosh/100/0",
    "outside/swapped_axes/1000/0",
];

/// Memory of this process \[MB\]: `VmRSS` now, `VmHWM` at most; `None` where the system does not say.
fn megabytes(which: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(which))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

/// Forgets the largest memory so far, which the construction of the case took; where the system does not allow it,
/// the largest of all is shown.
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

fn ten_minutes(criterion: &mut Criterion) {
    let laboratory = Laboratory::whorl_1().unwrap();
    let mut group = criterion.benchmark_group("ten_minutes");
    group.sample_size(10).measurement_time(Duration::from_secs(30));
    for key in CASES {
        let spec = all_specs(1, false).into_iter().find(|s| s.key() == key).unwrap();
        let stand = Arc::new(Stand::new(&laboratory, &stand_key(&spec), &spec));
        let built = build(&laboratory, &stand, &spec).unwrap();
        // Three runs of 90 s twice over, and one held out: 10.5 minutes.
        let training: Vec<_> = built.training.iter().chain(&built.training).cloned().collect();
        let options = Options { threads: 2, ..Options::default() };
        forget_peak();
        let before = megabytes("VmRSS");
        group.bench_function(key, |bencher| {
            bencher.iter(|| {
                diagnose(&training, &built.held_out, &built.model, &built.prior, &options, &mut |_| {})
                    .unwrap()
            });
        });
        if let (Some(peak), Some(before)) = (megabytes("VmHWM"), before) {
            println!("{key}: {peak:.0} MB at most, {before:.0} MB of them before, mostly the recordings");
        }
    }
    group.finish();
}

criterion_group!(benches, ten_minutes);
criterion_main!(benches);
