//! What the comparison of a run of some length costs in memory.

use super::compare;
use super::generator::{Manoeuvre, platform, record};

/// Bytes for each further sample at 100 Hz, beside the recording itself: an innovation of each of twelve components, and inputs that
/// they may follow. Predictions and covariances of a whole run would be thousands.
const MOST_PER_SAMPLE: f64 = 600.0;

#[test]
fn predictions_of_a_long_run_are_never_there_at_once() {
    let model = platform();
    let peak = |duration_s: f64| {
        let recording = record(&model, &Manoeuvre { duration_s, jet_period_s: 0.0, ..Manoeuvre::default() });
        let counted = allocation_counter::measure(|| {
            compare(&recording, &model).unwrap();
        });
        counted.bytes_max as f64
    };
    // What is kept of a block of a run, of means of readings, has room enough in the shorter one.
    let (short_s, long_s) = (480.0, 600.0);
    let per_sample = (peak(long_s) - peak(short_s)) / ((long_s - short_s) * 100.0);
    assert!(per_sample < MOST_PER_SAMPLE, "{per_sample:.0} bytes for each sample");
}
