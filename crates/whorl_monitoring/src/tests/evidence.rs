use nalgebra::{DMatrix, DVector};

use whorl_prediction::Since;

use crate::evidence::Suspect;

const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

fn suspect(count: usize, stddev: f64) -> Suspect {
    let columns = (0..count).map(|k| (k, stddev, ANY)).collect();
    let products = 0;
    Suspect { effect: "drag", columns, products, ln_prior: 0.0 }
}

fn sums(slope: &[f64], pairs: &[f64]) -> Since {
    Since {
        start_ns: 0,
        slope: slope.to_vec(),
        information: pairs.to_vec(),
        absolute: vec![0.0; slope.len()],
    }
}

/// One column: the integral of the likelihood over the prior, by the trapezoidal rule.
#[test]
fn the_ratio_is_the_likelihood_integrated_over_the_prior() {
    let suspect = suspect(1, 0.7);
    let (x, y) = ([0.3, -1.0, 2.0, 0.4], [0.5, -0.2, 1.7, 0.1]);
    let information: f64 = x.iter().map(|x| x * x).sum();
    let score: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
    let sums = sums(&[score], &[information]);
    let sigma = 0.7 * 3.0;
    let density = |phi: f64| {
        let misfit: f64 = x.iter().zip(y).map(|(x, y)| (y - x * phi).powi(2) - y * y).sum();
        (-0.5 * misfit - 0.5 * (phi / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt())
    };
    let step = 1e-3;
    let integral: f64 = (-20_000..20_000).map(|k| density(f64::from(k) * step) * step).sum();
    assert!((suspect.posterior(&sums, 3.0, 0.0).unwrap().0 - integral.ln()).abs() < 1e-9);
}

/// Three columns, against the formula of METHOD.md in matrices.
#[test]
fn the_ratio_of_several_columns_is_the_formula() {
    let suspect = suspect(3, 0.7);
    let x = DMatrix::from_fn(5, 3, |i, j| ((i * 3 + j) as f64).sin());
    let y = DVector::from_fn(5, |i, _| (i as f64).cos());
    let (a, z) = (x.transpose() * &x, x.transpose() * &y);
    let products = [a[(0, 0)], a[(0, 1)], a[(1, 1)], a[(0, 2)], a[(1, 2)], a[(2, 2)]];
    let sums = sums(z.as_slice(), &products);
    let s = 0.7 * 3.0;
    let inner = DMatrix::identity(3, 3) + &a * (s * s);
    let quadratic = (z.transpose() * inner.clone().try_inverse().unwrap() * &z)[0] * s * s;
    let expected = 0.5 * (quadratic - inner.determinant().ln());
    assert!((suspect.posterior(&sums, 3.0, 0.0).unwrap().0 - expected).abs() < 1e-12);
}

/// What data put beyond a range is no explanation, unless it is so by chance.
#[test]
fn what_no_rig_can_have_is_no_explanation() {
    let sums = sums(&[100.0], &[50.0]);
    let of = |most: f64| {
        let suspect = Suspect { columns: vec![(0, 1.0, (-most, most))], ..suspect(1, 1.0) };
        suspect.posterior(&sums, 1.0, 0.0).map(|posterior| posterior.1[0].0)
    };
    // 100/(50 + 1) = 1.96 +- 0.14.
    for most in [3.0, 1.8] {
        assert!((of(most).unwrap() - 100.0 / 51.0).abs() < 1e-12);
    }
    assert_eq!(of(0.3), None);
}

/// Readings that are always off by less than what is allowed are no news, however many; a clear one is.
#[test]
fn a_small_error_that_lasts_is_no_evidence() {
    let suspect = suspect(1, 0.7);
    let ratio = |per_reading: f64, count: f64| {
        let sums = Since { absolute: vec![count], ..sums(&[per_reading * count], &[count]) };
        (suspect.posterior(&sums, 1.0, 0.2).unwrap().0, suspect.posterior(&sums, 1.0, 0.0).unwrap().0)
    };
    for count in [1e2, 1e4, 1e6] {
        let (discounted, plain) = ratio(0.15, count);
        assert!(discounted < 0.0 && (count < 1e4 || plain > 50.0), "{discounted} {plain}");
        assert!(ratio(1.0, count).0 > 0.3 * count - 8.0);
    }
}
