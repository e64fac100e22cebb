//! Valves that open late and fill a volume.

use whorl_challenge::truth::valves::Valves;
use whorl_recording::OnInterval;

#[test]
fn plenum_keeps_the_impulse() {
    let pulses = vec![vec![OnInterval { on_s: 1.0, off_s: 1.5 }]];
    for fill_s in [0.0, 0.02] {
        let valves = Valves::new(&pulses, |_, _| (0.01, 0.02), fill_s);
        let step = 1e-4;
        let impulse: f64 = (0..40_000).map(|i| valves.fraction(0, (f64::from(i) + 0.5) * step) * step).sum();
        assert!((impulse - 0.51).abs() < 3e-4, "{fill_s}: {impulse}");
        assert!(
            valves.blowing(1.2) == [0] && valves.blowing(0.5).is_empty() && valves.blowing(3.0).is_empty()
        );
    }
}
