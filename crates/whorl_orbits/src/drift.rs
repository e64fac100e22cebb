//! What keeps two orbits together: equal energy.
//!
//! Two unperturbed orbits have the same period, and their spacecraft do not drift apart, exactly if their semi-major axes,
//! that is their energies, are equal, whatever both eccentricities are and however far apart the spacecraft stand. (2.31),
//! `y' + 2 n x = 0`, is the first order of that for a chief on a circle; at separations of tens of kilometres what it
//! neglects, `rho^2 / R`, is larger than any real drift.
//!
//! The smallest velocity change that gives the deputy a wanted energy is along its own inertial velocity (the gradient of
//! the kinetic energy): `|v|^2 -> |v|^2 + 2 (E_chief - E_deputy)`.
//!
//! For linearised models the same statement to first order, with `E = v^2/2 - mu/r`:
//!
//! ```text
//! dE = v_c . (rho' + w x rho) + mu/r_c^2 x,      dv = -dE/|v_c|^2 v_c
//! ```
//!
//! On a circle `dE = n a (y' + 2 n x)`, which is (2.31).
//!
//! With J2 energy is conserved as well (the Earth's axis is one of symmetry), its potential included. The energies then
//! fix the mean semi-major axes; drifts from different inclinations or eccentricities, which J2 makes, remain.
//!
//! Source: K. T. Alfriend et al., *Spacecraft Formation Flying*, Elsevier 2010, sections 4.4 and 8.1 (energy matching).

use nalgebra::Vector3;

use crate::EARTH_MU_M3_S2;
use crate::hill::{HillState, anomaly_rate_rad_s};
use crate::orbit_state::OrbitState;
use crate::propagation::Propagator;

/// The smallest velocity change after which the deputy's energy is the chief's, inertial axes \[m/s\].
///
/// Zero where no speed has that energy (a deputy far above a chief that never comes there).
#[must_use]
pub fn delta_v_eci_m_s(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState) -> Vector3<f64> {
    let short_m2_s2 = propagator.energy_m2_s2(chief) - propagator.energy_m2_s2(deputy);
    let squared = deputy.velocity_m_s.norm_squared();
    if squared <= 0.0 || squared + 2.0 * short_m2_s2 < 0.0 {
        return Vector3::zeros();
    }
    // sqrt(1 + x) - 1 without the cancellation.
    let x = 2.0 * short_m2_s2 / squared;
    deputy.velocity_m_s * (x / (1.0 + (1.0 + x).sqrt()))
}

/// Drift of a deputy ahead of its chief that their energies mean, along the track [m/revolution]: -3 pi times the
/// difference of the semi-major axes.
#[must_use]
pub fn drift_m_rev(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState) -> f64 {
    let [of_chief, of_deputy] = [chief, deputy].map(|state| propagator.energy_m2_s2(state));
    // a = -mu / (2 E): exact, as the energies are close.
    let longer_m = -0.5 * EARTH_MU_M3_S2 * (of_chief - of_deputy) / (of_chief * of_deputy);
    -3.0 * std::f64::consts::PI * longer_m
}

/// The same for models that are linear in the separation, Hill axes \[m/s\].
#[must_use]
pub fn linear_delta_v_hill_m_s(chief: &OrbitState, deputy: &HillState) -> Vector3<f64> {
    let radius_m = chief.position_m.norm();
    let rate_rad_s = anomaly_rate_rad_s(chief);
    let radial_m_s = chief.position_m.dot(&chief.velocity_m_s) / radius_m;
    let velocity = Vector3::new(radial_m_s, radius_m * rate_rad_s, 0.0);
    let inertial = deputy.velocity_m_s + Vector3::new(0.0, 0.0, rate_rad_s).cross(&deputy.position_m);
    let excess = velocity.dot(&inertial) + EARTH_MU_M3_S2 / (radius_m * radius_m) * deputy.position_m.x;
    -velocity * (excess / velocity.norm_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Elements, test_chief as chief};
    use crate::yamanaka_ankersen;
    use proptest::prelude::*;

    /// In-track position of a deputy after some revolutions of its chief less that at the start, for each revolution \[m\].
    fn drift_m(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState, period_s: f64) -> f64 {
        let revolutions = 5.0;
        let along = |t: f64| {
            let [c, d] = [chief, deputy].map(|s| propagator.after(s, t).unwrap());
            HillState::of(&c, &d).position_m.y
        };
        (along(revolutions * period_s) - along(0.0)) / revolutions
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// The two-body propagator, which is compared with DOP853, is the judge.
        #[test]
        fn nothing_drifts_after_the_velocity_change(
            eccentricity in 0.0..0.6_f64,
            mean_anomaly in -3.0..3.0_f64,
            p in prop::array::uniform3(-30e3..30e3_f64),
            v in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let elements = chief(eccentricity, mean_anomaly);
            let (start, period_s) = (elements.state(), elements.period_s());
            let mut deputy = HillState { position_m: p.into(), velocity_m_s: v.into() }.deputy(&start);
            let wanted = delta_v_eci_m_s(Propagator::TwoBody, &start, &deputy);
            deputy.velocity_m_s += wanted;
            let drift = drift_m(Propagator::TwoBody, &start, &deputy, period_s);
            prop_assert!(drift.abs() < 0.01, "{drift} m a revolution");
            // What it costs is the whole drift: 3 pi dv / n a revolution on a circle.
            let again = delta_v_eci_m_s(Propagator::TwoBody, &start, &deputy);
            prop_assert!(again.norm() < 1e-9);
        }

        #[test]
        fn the_linear_form_stops_the_linear_model_on_any_ellipse(
            eccentricity in 0.0..0.6_f64,
            mean_anomaly in -3.0..3.0_f64,
            p in prop::array::uniform3(-30e3..30e3_f64),
            v in prop::array::uniform3(-3.0..3.0_f64),
        ) {
            let elements = chief(eccentricity, mean_anomaly);
            let mut deputy = HillState { position_m: p.into(), velocity_m_s: v.into() };
            deputy.velocity_m_s += linear_delta_v_hill_m_s(&elements.state(), &deputy);
            let after = yamanaka_ankersen::after(&elements, &deputy, 3.0 * elements.period_s());
            // A linear motion without drift is periodic.
            prop_assert!((after.position_m - deputy.position_m).norm() < 1e-2, "{after:?} {deputy:?}");
        }
    }

    #[test]
    fn on_a_circle_the_linear_form_is_that_of_the_dissertation() {
        let elements = chief(0.0, 0.4);
        let deputy = HillState {
            position_m: Vector3::new(300.0, -2000.0, 500.0),
            velocity_m_s: Vector3::new(0.2, -0.1, 0.3),
        };
        let wanted = linear_delta_v_hill_m_s(&elements.state(), &deputy);
        let by_hand = -(-0.1 + 2.0 * elements.mean_motion_rad_s() * 300.0);
        assert!((wanted - Vector3::new(0.0, by_hand, 0.0)).norm() < 1e-9, "{wanted}");
    }

    /// With J2 the osculating semi-major axis of an orbit varies by kilometres; the energy with its potential does not.
    #[test]
    fn with_the_oblateness_the_energies_are_compared_with_it() {
        let elements = chief(0.0, 0.4);
        let (start, period_s) = (elements.state(), elements.period_s());
        // 30 km ahead on the same orbit: the same inclination and shape.
        let ahead = Elements { mean_anomaly_rad: 0.4 + 30e3 / elements.semi_major_axis_m, ..elements };
        let mut with = ahead.state();
        let mut without = with;
        with.velocity_m_s += delta_v_eci_m_s(Propagator::J2, &start, &with);
        without.velocity_m_s += delta_v_eci_m_s(Propagator::TwoBody, &start, &without);
        let [with, without] = [with, without].map(|d| drift_m(Propagator::J2, &start, &d, period_s).abs());
        assert!(with < 0.1 * without && without > 100.0, "{with} {without} m a revolution");
    }
}
