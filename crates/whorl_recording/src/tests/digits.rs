use nalgebra::Vector3;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use whorl_dynamics::PlatformModel;

use crate::digits::*;
use crate::{Recording, Series};

/// Readings on a grid of their own are no chance, and each says so as much as it is unlikely; of others nothing is said.
#[test]
fn steps_of_a_gyro_are_as_sure_as_readings_are_many() {
    let model = PlatformModel::whorl_1_reference();
    let mut random = Pcg64::new(3, 5);
    let normal = Normal::new(0.0, 1e-3).unwrap();
    let values: Vec<Vector3<f64>> =
        (0..500).map(|_| Vector3::from_fn(|_, _| normal.sample(&mut random))).collect();
    let digits = |value: Vec<Vector3<f64>>| {
        let time_s = (0..value.len()).map(|i| i as f64 * 0.01).collect();
        let recording = Recording { gyro_b_rad_s: Series { time_s, value }, ..Recording::default() };
        digits_of_gyro(&recording, &model)
    };
    let free = digits(values.clone());
    assert!(free.clips_at_rad_s.is_none() && free.step_nats == 0.0, "{free:?}");
    let step = 1e-3;
    let coarse = digits(values.iter().map(|v| v.map(|x| (x / step).round() * step)).collect());
    assert!((coarse.step_rad_s - step).abs() < 1e-9, "{coarse:?}");
    assert!((coarse.step_nats - 500.0 * 25f64.ln()).abs() < 1e-6, "{coarse:?}");
    let limit = 1.2e-3;
    let clipped = digits(values.iter().map(|v| v.map(|x| x.clamp(-limit, limit))).collect());
    assert_eq!(clipped.clips_at_rad_s, Some(limit));
    assert!(clipped.clips_nats > 100.0, "{clipped:?}");
}
