//! Elliptic functions by the arithmetic-geometric mean (Abramowitz and Stegun, 17.6 and 16.4).

/// Complete elliptic integral K of parameter m = k^2.
pub fn complete_elliptic_k(m: f64) -> f64 {
    let (mut a, mut b) = (1.0, (1.0 - m).sqrt());
    for _ in 0..8 {
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
    }
    std::f64::consts::FRAC_PI_2 / a
}

/// sn, cn and dn of argument u and parameter m, 0 <= m < 1.
pub fn jacobi_sn_cn_dn(u: f64, m: f64) -> (f64, f64, f64) {
    const N: usize = 8;
    let (mut a, mut c) = ([0.0; N + 1], [0.0; N + 1]);
    let mut b = (1.0 - m).sqrt();
    (a[0], c[0]) = (1.0, m.sqrt());
    for n in 0..N {
        a[n + 1] = 0.5 * (a[n] + b);
        c[n + 1] = 0.5 * (a[n] - b);
        b = (a[n] * b).sqrt();
    }
    let mut phi = 2.0_f64.powi(N as i32) * a[N] * u;
    let mut next = phi;
    for n in (1..=N).rev() {
        next = phi;
        phi = 0.5 * (phi + (c[n] * phi.sin() / a[n]).asin());
    }
    let dn = if (next - phi).cos().abs() > 1e-3 {
        phi.cos() / (next - phi).cos()
    } else {
        (1.0 - m * phi.sin().powi(2)).sqrt()
    };
    (phi.sin(), phi.cos(), dn)
}

#[test]
fn match_printed_tables() {
    // K(0.5) of Abramowitz and Stegun, table 17.1.
    assert!((complete_elliptic_k(0.5) - 1.854_074_677_301_372).abs() < 1e-14);
    assert!((complete_elliptic_k(0.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    // sn(0.2 | 0.81), Abramowitz and Stegun, chapter 16, example 1: 0.19762.
    let (sn, cn, dn) = jacobi_sn_cn_dn(0.20, 0.81);
    assert!((sn - 0.197_62).abs() < 1e-5, "{sn}");
    assert!((sn * sn + cn * cn - 1.0).abs() < 1e-14);
    assert!((dn * dn + 0.81 * sn * sn - 1.0).abs() < 1e-12);
    // A quarter period.
    let (sn, cn, _) = jacobi_sn_cn_dn(complete_elliptic_k(0.5), 0.5);
    assert!((sn - 1.0).abs() < 1e-12 && cn.abs() < 1e-7);
}
