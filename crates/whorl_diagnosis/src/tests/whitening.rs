//! The filter turns a run of the very model into white noise of unit variance.

use whorl_dynamics::{ModelPrior, PlatformModel};

use super::generator::record;
use crate::evidence::ar_noise::ArModel;
use crate::evidence::problem::{Problem, ProcessNoise};
use crate::parameters::Reference;

#[test]
fn noise_that_is_not_as_stated_is_measured_and_told() {
    let truth = PlatformModel::whorl_1_reference();
    let recording = record(&truth, 2, 12.0, None);
    let remarks = |factor: f64| {
        let mut model = truth.clone();
        model.sensors.wheel_speed.noise_stddev_rad_s *= factor;
        let reference = Reference::new(&model, &ModelPrior::typical(&model));
        let problem = Problem::new(std::slice::from_ref(&recording), reference, 12.0, 1).unwrap();
        let of_noise = |text: &&String| text.contains("noise is");
        (
            problem.runs[0].noise.wheel,
            problem.runs[0].remarks.iter().filter(of_noise).cloned().collect::<Vec<_>>(),
        )
    };
    let (measured, said) = remarks(1.0);
    assert!((measured / truth.sensors.wheel_speed.noise_stddev_rad_s - 1.0).abs() < 0.1, "{measured}");
    assert!(said.is_empty(), "{said:?}");
    let (same, said) = remarks(4.0);
    assert_eq!(same, measured);
    assert!(said.len() == 1 && said[0].contains("the wheel speed's noise is 0.2"), "{said:?}");
    let (same, said) = remarks(0.25);
    assert_eq!(same, measured);
    let told = ["is 3.", "is 4."].iter().any(|times| said.iter().any(|text| text.contains(times)));
    assert!(said.len() == 1 && told, "{said:?}");
}

#[test]
fn the_true_model_leaves_white_noise() {
    let mut truth = PlatformModel::whorl_1_reference();
    // The stop stays out of reach: near it the filter knows that it does not know.
    truth.tilt_limit = whorl_dynamics::platform::TiltLimit::Cone { max_rad: 0.5 };
    let run = record(&truth, 7, 60.0, None);
    let reference = Reference::new(&truth, &ModelPrior::typical(&truth));
    let mut problem = Problem::new(std::slice::from_ref(&run), reference, run.duration_s(), 1).unwrap();
    let point = problem.reference.point();
    for walk in [0.3, 5e-3] {
        problem.smooth(&point, ProcessNoise::Fixed(walk)).unwrap();
    }
    let linear = problem.linearise(&point).unwrap();
    let (whitened, readings) = (&linear[0].gains.whitened, &linear[0].gains.readings());
    let components: std::collections::BTreeSet<_> = readings.iter().copied().collect();
    // Three axes of gyro and accelerometer, two sides of the vector sensor, three wheels.
    assert_eq!(components.len(), 11);
    for component in components {
        let values: Vec<f64> =
            whitened.iter().zip(readings).filter(|(_, c)| **c == component).map(|(w, _)| *w).collect();
        let n = values.len() as f64;
        let power = values.iter().map(|v| v * v).sum::<f64>() / n;
        let lag = values.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n / power;
        // The noise level is measured from the same data, to a few per cent.
        assert!((power - 1.0).abs() < 0.08 + 5.0 * (2.0 / n).sqrt(), "{component:?}: power {power}");
        assert!(lag.abs() < 4.5 / n.sqrt() + 0.02, "{component:?}: correlation {lag}");
        assert!(
            ArModel::of(&values, &crate::Settings::default()).coefficients.iter().all(|a| a.abs() < 0.15)
        );
    }
}
