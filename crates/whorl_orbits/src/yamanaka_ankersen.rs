//! Motion relative to a chief on an ellipse, linearised (Tschauner-Hempel), as a state-transition matrix.
//!
//! Source: K. Yamanaka, F. Ankersen, "New state transition matrix for relative motion on an arbitrary elliptical
//! orbit", J. Guidance, Control, and Dynamics 25(1), 2002, equations 82-86. Their axes: x along track, y opposite
//! the orbit normal, z to the Earth; here the result is in the Hill frame.
//!
//! With `rho = 1 + e cos nu`, `s = rho sin nu`, `c = rho cos nu`, `k^2 = sqrt(mu/p^3)`, `J = k^2 t` and states scaled
//! as `r~ = rho r`, `v~ = -e sin nu r + v/(k^2 rho)`.
//!
//! Assumptions: separations small against the chief's radius, no perturbations, e below 1.

use nalgebra::{Matrix4, Vector3, Vector4};

use crate::EARTH_MU_M3_S2;
use crate::elements::Elements;
use crate::hill::HillState;

/// The deputy `t_s` later, for a chief with these elements now.
#[must_use]
pub fn after(chief: &Elements, deputy: &HillState, t_s: f64) -> HillState {
    let e = chief.eccentricity;
    let k2 = (EARTH_MU_M3_S2 / chief.parameter_m().powi(3)).sqrt();
    let (nu0, nu) = (chief.true_anomaly_rad(), chief.after(t_s).true_anomaly_rad());
    let (start, end) = (Scaling::at(e, nu0, k2), Scaling::at(e, nu, k2));

    // Their axes: x = along track, y = -normal, z = -radial.
    let to_theirs = |v: &Vector3<f64>| Vector3::new(v.y, -v.z, -v.x);
    let to_hill = |v: &Vector3<f64>| Vector3::new(-v.z, v.x, -v.y);
    let (r0, v0) = start.scaled(&to_theirs(&deputy.position_m), &to_theirs(&deputy.velocity_m_s));

    let constants = first(e, &start) * Vector4::new(r0.x, r0.z, v0.x, v0.z);
    let in_plane = second(e, &end, k2 * t_s) * constants;
    let (sine, cosine) = (nu - nu0).sin_cos();
    let r = Vector3::new(in_plane[0], cosine * r0.y + sine * v0.y, in_plane[1]);
    let v = Vector3::new(in_plane[2], -sine * r0.y + cosine * v0.y, in_plane[3]);
    let (position, velocity) = end.unscaled(&r, &v);
    HillState { position_m: to_hill(&position), velocity_m_s: to_hill(&velocity) }
}

struct Scaling {
    e_sine: f64,
    rho: f64,
    s: f64,
    c: f64,
    s_prime: f64,
    c_prime: f64,
    k2: f64,
}

impl Scaling {
    fn at(e: f64, anomaly_rad: f64, k2: f64) -> Self {
        let (sine, cosine) = anomaly_rad.sin_cos();
        let rho = 1.0 + e * cosine;
        Self {
            e_sine: e * sine,
            rho,
            s: rho * sine,
            c: rho * cosine,
            s_prime: cosine + e * (2.0 * anomaly_rad).cos(),
            c_prime: -(sine + e * (2.0 * anomaly_rad).sin()),
            k2,
        }
    }

    fn scaled(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        (r * self.rho, -r * self.e_sine + v / (self.k2 * self.rho))
    }

    fn unscaled(&self, r: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        (r / self.rho, (r * self.e_sine + v * self.rho) * self.k2)
    }
}

/// Equation 82: constants of the motion from the scaled state (x, z, vx, vz).
fn first(e: f64, at: &Scaling) -> Matrix4<f64> {
    let (rho, s, c) = (at.rho, at.s, at.c);
    let e2 = 1.0 - e * e;
    let inverse = 1.0 + 1.0 / rho;
    #[rustfmt::skip]
    let matrix = Matrix4::new(
        e2, 3.0 * e * s / rho * inverse, -e * s * inverse, -e * c + 2.0,
        0.0, -3.0 * s / rho * (1.0 + e * e / rho), s * inverse, c - 2.0 * e,
        0.0, -3.0 * (c / rho + e), c * inverse + e, -s,
        0.0, 3.0 * rho + e * e - 1.0, -rho * rho, e * s,
    );
    matrix / e2
}

/// Equation 84: the scaled state from those constants.
fn second(e: f64, at: &Scaling, j: f64) -> Matrix4<f64> {
    let (rho, s, c) = (at.rho, at.s, at.c);
    let inverse = 1.0 + 1.0 / rho;
    #[rustfmt::skip]
    let matrix = Matrix4::new(
        1.0, -c * inverse, s * inverse, 3.0 * rho * rho * j,
        0.0, s, c, 2.0 - 3.0 * e * s * j,
        0.0, 2.0 * s, 2.0 * c - e, 3.0 * (1.0 - 2.0 * e * s * j),
        0.0, at.s_prime, at.c_prime, -3.0 * e * (at.s_prime * j + s / (rho * rho)),
    );
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::test_chief as chief;
    use crate::{clohessy_wiltshire, relative_motion};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        #[test]
        fn it_is_the_nonlinear_motion_in_the_limit_of_small_separations(
            eccentricity in 0.0..0.7_f64,
            mean_anomaly in -3.0..3.0_f64,
            p in prop::array::uniform3(-1.0..1.0_f64),
            v in prop::array::uniform3(-1e-3..1e-3_f64),
            revolutions in 0.0..1.0_f64,
        ) {
            let chief = chief(eccentricity, mean_anomaly);
            let deputy = HillState { position_m: p.into(), velocity_m_s: v.into() };
            let t = revolutions * chief.period_s();
            let linear = after(&chief, &deputy, t);
            let full = relative_motion::after(&chief.state(), &deputy, t);
            // The neglected terms grow with the square of the separation: (100 m)^2 / 7000 km.
            let separation_m = linear.position_m.norm() + 1.0;
            let size = separation_m * (1.0 + separation_m / 100.0);
            prop_assert!((linear.position_m - full.position_m).norm() < 2e-5 * size, "{linear:?} {full:?}");
            prop_assert!((linear.velocity_m_s - full.velocity_m_s).norm() < 2e-8 * size);
        }

        #[test]
        fn on_a_circle_it_is_clohessy_and_wiltshire(
            p in prop::array::uniform3(-100.0..100.0_f64),
            v in prop::array::uniform3(-0.1..0.1_f64),
            t in 0.0..9000.0_f64,
        ) {
            let chief = chief(0.0, 0.4);
            let deputy = HillState { position_m: p.into(), velocity_m_s: v.into() };
            let (a, b) = (after(&chief, &deputy, t), clohessy_wiltshire::closed_form(&deputy, chief.mean_motion_rad_s(), t));
            prop_assert!((a.position_m - b.position_m).norm() < 1e-6);
            prop_assert!((a.velocity_m_s - b.velocity_m_s).norm() < 1e-9);
        }
    }
}
