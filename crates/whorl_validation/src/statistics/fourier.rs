//! Fast Fourier transform of power-of-two length.

use std::f64::consts::TAU;

/// Squared magnitudes of the transform at frequencies 1..n/2 of `values`, whose number is a power of two.
pub(super) fn power(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    debug_assert!(n.is_power_of_two());
    let mut re: Vec<f64> = values.to_vec();
    let mut im = vec![0.0; n];
    let bits = n.trailing_zeros();
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - bits.max(1));
        if bits > 0 && i < j {
            re.swap(i, j);
        }
    }
    let mut half = 1;
    while half < n {
        for k in 0..half {
            let (sin, cos) = (-TAU * k as f64 / (2 * half) as f64).sin_cos();
            for first in (k..n).step_by(2 * half) {
                let second = first + half;
                let (a, b) = (re[second] * cos - im[second] * sin, re[second] * sin + im[second] * cos);
                (re[second], im[second]) = (re[first] - a, im[first] - b);
                re[first] += a;
                im[first] += b;
            }
        }
        half *= 2;
    }
    (1..n / 2).map(|k| re[k] * re[k] + im[k] * im[k]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_definition() {
        let values: Vec<f64> = (0..32).map(|k| f64::from(k * k % 7) - 0.3 * f64::from(k)).collect();
        for (index, found) in power(&values).iter().enumerate() {
            let k = (index + 1) as f64;
            let sum = |f: fn(f64) -> f64| -> f64 {
                values.iter().enumerate().map(|(t, x)| x * f(TAU * k * t as f64 / 32.0)).sum()
            };
            let expected = sum(f64::cos).powi(2) + sum(f64::sin).powi(2);
            assert!((found - expected).abs() < 1e-9 * expected.max(1.0), "{k}: {found} {expected}");
        }
    }
}
