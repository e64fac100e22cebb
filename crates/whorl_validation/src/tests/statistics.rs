//! Statistics compared with numbers of another program (`statistics_reference.py`) and closed forms.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use whorl_math::statistics::{autocorrelations, chi_squared_quantile, ljung_box};

/// The same series as in `statistics_reference.py`.
fn series() -> Vec<f64> {
    let mut state: u64 = 12345;
    let mut previous = 0.0;
    (0..400)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let uniform = (state >> 11) as f64 / (1u64 << 53) as f64;
            previous = 0.3 * previous + uniform - 0.5;
            previous
        })
        .collect()
}

#[test]
fn ljung_box_agrees_with_statsmodels() {
    let x = series();
    for (lags, statistic, p_value) in REFERENCE_LJUNG_BOX {
        let found = ljung_box(&x, lags).unwrap();
        assert!((found.0 / statistic - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.1 - p_value).abs() < 1e-6, "{found:?}");
    }
    let limit = chi_squared_quantile(0.99, 25);
    assert!((limit - REFERENCE_LIMIT_25).abs() < 1e-4, "{limit}");
}

#[test]
fn correlations_agree_with_numpy() {
    let x = series();
    let r: Vec<f64> = autocorrelations(&x).unwrap().take(4).collect();
    for (found, expected) in r.iter().zip(REFERENCE_AUTOCORRELATION) {
        assert!((found - expected).abs() < 1e-12, "{r:?}");
    }
}

#[test]
fn the_test_refuses_white_noise_once_in_a_hundred() {
    let mut random = Pcg64::new(99, 7);
    let mut refused = 0;
    for _ in 0..1000 {
        let x: Vec<f64> = (0..512).map(|_| StandardNormal.sample(&mut random)).collect();
        refused += u32::from(ljung_box(&x, 25).unwrap().1 < 0.01);
    }
    // Ten expected, standard deviation three.
    assert!((1..=25).contains(&refused), "{refused}");
}

#[test]
fn series_that_do_not_vary_have_no_statistics() {
    assert_eq!(ljung_box(&[1.0; 200], 25), None);
    assert_eq!(ljung_box(&[1.0, 2.0], 25), None);
}

const REFERENCE_LJUNG_BOX: [(u32, f64, f64); 3] = [
    (1, 3.346198180903055e+01, 7.267070093607374e-09),
    (5, 3.755515480067896e+01, 4.634841385757464e-07),
    (25, 6.813927299793798e+01, 7.243386042349414e-06),
];
const REFERENCE_LIMIT_25: f64 = 4.431410489621915e+01;
const REFERENCE_AUTOCORRELATION: [f64; 4] =
    [1.0, 2.881504187350489e-01, 4.823667185065316e-02, -4.713214768158148e-02];
