//! Torque-free asymmetric body against Jacobi elliptic functions.

use nalgebra::{Matrix3, Vector3};

use super::special_functions::jacobi_sn_cn_dn;
use super::{free_platform, ns, plant, set_mass, start};

/// Landau and Lifshitz, Mechanics, section 37 (I3 > I2 > I1, M^2 > 2 E I2):
/// w1 = a cn, w2 = b sn, w3 = c dn of tau = t sqrt((I3 - I2)(M^2 - 2 E I1)/(I1 I2 I3)),
/// k^2 = (I2 - I1)(2 E I3 - M^2) / ((I3 - I2)(M^2 - 2 E I1)).
#[test]
fn asymmetric_body_follows_jacobi_elliptic_functions() {
    let [i1, i2, i3] = [6.0, 8.0, 12.0];
    let mut model = free_platform();
    model.wheels_mut().clear();
    set_mass(&mut model, Some(Matrix3::from_diagonal(&Vector3::new(i1, i2, i3))), Vector3::zeros());
    let omega_0 = Vector3::new(0.4, 0.0, 0.5);
    let twice_energy = i1 * 0.4 * 0.4 + i3 * 0.5 * 0.5;
    let momentum_2 = (i1 * 0.4_f64).powi(2) + (i3 * 0.5_f64).powi(2);
    assert!(momentum_2 > twice_energy * i2);
    let rate = ((i3 - i2) * (momentum_2 - twice_energy * i1) / (i1 * i2 * i3)).sqrt();
    let k2 = (i2 - i1) * (twice_energy * i3 - momentum_2) / ((i3 - i2) * (momentum_2 - twice_energy * i1));
    let amplitude = [
        ((twice_energy * i3 - momentum_2) / (i1 * (i3 - i1))).sqrt(),
        ((twice_energy * i3 - momentum_2) / (i2 * (i3 - i2))).sqrt(),
        ((momentum_2 - twice_energy * i1) / (i3 * (i3 - i1))).sqrt(),
    ];
    let mut p = plant(&model, &start(omega_0, &[]));
    for k in 0..=60 {
        let t = f64::from(k);
        p.advance_to(ns(t)).unwrap();
        let (sn, cn, dn) = jacobi_sn_cn_dn(rate * t, k2);
        // With I1 < I2 < I3 Euler's second equation gives w2 the sign of (I3 - I1) w3 w1 > 0.
        let expected = Vector3::new(amplitude[0] * cn, amplitude[1] * sn, amplitude[2] * dn);
        let error = (p.state().omega_wb_b_rad_s - expected).norm();
        assert!(error < 1e-10, "at {t} s: {error}");
    }
}
