//! Filters of the inertial unit against closed forms.

use whorl_challenge::truth::filter::{Filtering, Filters, Seen};

/// Output after `time_s` of an input in fine steps; channels of the gyro get a ramp, those of the accelerometer a step at
/// 0.05 s.
fn output(filters: Filters, time_s: f64) -> Seen {
    let input = |t: f64, before: bool| {
        let step = if t > 0.05 || (t == 0.05 && !before) { 1.0 } else { 0.0 };
        Seen::from_fn(|i, _| if i < 3 { 2.0 * t } else { step })
    };
    let mut filtering = Filtering::new(filters, 0.0, input(0.0, true));
    let count = (time_s / 5e-4).round() as usize;
    for k in 0..count {
        let (from, to) = (5e-4 * k as f64, 5e-4 * (k + 1) as f64);
        // 100 steps of 0.5 ms are not exactly 0.05 s.
        let at = |t: f64| if (t - 0.05).abs() < 1e-9 { 0.05 } else { t };
        filtering.advance(to, &input(at(from), false), &input(at(to), true));
    }
    filtering.output()
}

#[test]
fn a_low_pass_and_a_window_follow_ramp_and_step() {
    let delay_s = [0.02, 0.01];
    for time_s in [0.03, 0.06, 0.08, 0.2] {
        let low_pass = output(Filters { delay_s, windows: false }, time_s);
        let ramp = 2.0 * (time_s - 0.02 + 0.02 * f64::exp(-time_s / 0.02));
        let since_s = f64::max(time_s - 0.05, 0.0);
        assert!((low_pass[0] - ramp).abs() < 1e-5, "{time_s}: {low_pass} {ramp}");
        assert!((low_pass[5] - (1.0 - f64::exp(-since_s / 0.01))).abs() < 2e-4, "{time_s}: {low_pass}");
        let window = output(Filters { delay_s, windows: true }, time_s);
        // Mean of the last 0.04 s; the input stood still before.
        let covered_s = time_s.min(0.04);
        let mean = 2.0 * covered_s / 0.04 * (time_s - 0.5 * covered_s);
        assert!((window[1] - mean).abs() < 1e-12, "{time_s}: {window} {mean}");
        assert!((window[4] - (since_s / 0.02).min(1.0)).abs() < 1e-9, "{time_s}: {window}");
    }
    // Nothing is filtered.
    assert_eq!(output(Filters::default(), 0.06), Seen::from_fn(|i, _| if i < 3 { 0.12 } else { 1.0 }));
}
