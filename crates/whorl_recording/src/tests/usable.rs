use nalgebra::Vector3;

use crate::usable::*;

fn noisy(n: usize) -> Vec<Vector3<f64>> {
    // A linear congruential generator serves: only scatter is wanted.
    let mut state = 1_u64;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..n)
        .map(|k| Vector3::new((0.02 * k as f64).sin() + 0.01 * draw(), 0.01 * draw(), 0.01 * draw()))
        .collect()
}

#[test]
fn single_readings_that_stand_out_are_found_and_steps_and_bursts_are_not() {
    let mut values = noisy(2000);
    assert!(ordinary(&values).iter().all(|x| *x));
    values[700].y += 0.3;
    values[900].x -= 0.5;
    // A step, and a pulse of several samples, are motion.
    values.iter_mut().skip(1200).for_each(|v| v.z += 0.4);
    values.iter_mut().skip(1500).take(4).for_each(|v| v.y += 0.4);
    let found = ordinary(&values);
    let out: Vec<usize> = (0..found.len()).filter(|k| !found[*k]).collect();
    assert_eq!(out, [700, 900]);
    // One in fifty is how this sensor is.
    values.iter_mut().step_by(50).for_each(|v| v.y += 0.3);
    assert!(ordinary(&values).iter().all(|x| *x));
}

#[test]
fn ends_of_a_range_show_by_themselves() {
    let mut values = noisy(2000);
    for v in &mut values {
        v.x = v.x.clamp(-0.8, 0.9);
    }
    assert_eq!(ends(&values, 0), (-0.8, 0.9));
    assert_eq!(ends(&values, 1), (f64::NEG_INFINITY, f64::INFINITY));
    let kept = within(&values, f64::INFINITY);
    assert!(kept.iter().zip(&values).all(|(kept, v)| *kept == (v.x > -0.8 && v.x < 0.9)));
    // Weight at rest, read in steps as wide as its noise: the largest number is read again and again, and is none.
    let steps: Vec<Vector3<f64>> =
        noisy(20_000).iter().map(|v| Vector3::z() * (9.81 + 0.01 * (200.0 * v.y).round())).collect();
    assert!(steps.windows(3).filter(|w| w.iter().all(|v| v.z == 9.82)).count() > PLATEAU_SAMPLES);
    assert_eq!(ends(&steps, 2), (f64::NEG_INFINITY, f64::INFINITY));
}
