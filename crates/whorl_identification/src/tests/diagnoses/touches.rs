//! Runs that touch the stop of their bearing.

use whorl_dynamics::PlatformModel;
use whorl_prediction::{Noise, Prepared, Settings, follow, follow_again};

use super::generator::record;

/// Valves that open and close later by so much each \[s\].
const STEP_S: f64 = 0.5e-3;

/// The log likelihood of a run that goes from stop to stop is a hill, no mountain range: it bends by what the recordings say of a delay and does
/// not jump. With touches that are known exactly it jumps by 15 to 60 from each of these delays to the next.
#[test]
fn a_run_from_stop_to_stop_has_a_smooth_likelihood() {
    let truth = PlatformModel::whorl_1_reference();
    let run = record(&truth, 11, 50.0, None);
    let likelihood_of = |settings: Settings| -> Vec<f64> {
        let case = Prepared::new(&run, &truth, settings).unwrap();
        let known = follow(&case, &Noise::stated(&case).unwrap());
        let of_delay = |k: i32| {
            let mut model = truth.clone();
            for jet in model.jets_mut() {
                jet.opening_delay_s += STEP_S * f64::from(k);
                jet.closing_delay_s += STEP_S * f64::from(k);
            }
            let case = Prepared::new(&run, &model, settings).unwrap();
            follow_again(&case, &Noise::stated(&case).unwrap(), &known).log_likelihood()
        };
        (-3..=6).map(of_delay).collect()
    };
    let roughest = |all: &[f64]| all.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs()).fold(0.0, f64::max);
    let settings = Settings::default();
    let smooth = likelihood_of(settings);
    let exact = likelihood_of(Settings { touch_impulse_share: 0.0, ..settings });
    assert!(roughest(&smooth) < 5.0, "{smooth:?}");
    assert!(roughest(&exact) > 15.0, "the run no longer touches its stop: {exact:?}");
}
