use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use nalgebra::{Complex, Vector6};
use whorl_math::spectrum::{common_motion, surprise_of_motion};

use crate::signals::seen::*;

#[test]
fn noise_has_so_much_of_one_motion_as_seldom_as_is_said() {
    let mut random = Pcg64::new(5, 3);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let count = 30_000;
    let surprising = (0..count)
        .filter(|_| {
            let mut one = || Complex::new(noise(), noise()) * 0.5_f64.sqrt();
            let of_run: Vec<Vector6<Complex<f64>>> = (0..3).map(|_| Vector6::from_fn(|_, _| one())).collect();
            surprise_of_motion(common_motion(&of_run).0, 3) > 300f64.ln()
        })
        .count();
    // One in 300, to leading order.
    assert!((50..200).contains(&surprising), "{surprising}");
}

/// Fits to noise and a sine of this size, in units of the noise of one phase.
fn fits(size: f64, noise: &mut dyn FnMut() -> f64) -> Vec<Fit> {
    [1.0, 3.0, 0.3, 2.0, 5.0, 0.1]
        .into_iter()
        .map(|information: f64| {
            let turn = 3.0 * noise();
            let signal = size * information.sqrt();
            let (a, b) = (signal * turn.cos() + noise(), signal * turn.sin() + noise());
            Fit { drop: a * a + b * b, information, explained: Default::default() }
        })
        .collect()
}

/// Noise seldom has any evidence of an imbalance, and one ten standard deviations large is found at its size.
#[test]
fn evidence_of_an_imbalance_is_not_made_by_noise() {
    let mut random = Pcg64::new(9, 1);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let by_noise = (0..8000).filter(|_| one_size(&fits(0.0, &mut noise)).unwrap().0 > 5.0).count();
    assert!(by_noise < 40, "{by_noise}");
    let strong: Vec<(f64, f64)> = (0..200).map(|_| one_size(&fits(3.0, &mut noise)).unwrap()).collect();
    let mean_size = strong.iter().map(|(_, size)| size).sum::<f64>() / 200.0;
    let plain = strong.iter().filter(|(evidence, _)| *evidence > 20.0).count();
    assert!((mean_size - 3.0).abs() < 0.1 && plain > 190, "{mean_size} {plain}");
}
