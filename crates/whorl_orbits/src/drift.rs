//! What keeps two orbits together: equal energies, and with the oblateness equal secular rates along the track.
//!
//! Two unperturbed orbits have the same period, and their spacecraft do not drift apart, exactly if their semi-major axes,
//! that is their energies, are equal, whatever both eccentricities are and however far apart the spacecraft stand. (2.31),
//! `y' + 2 n x = 0`, is the first order of that for a chief on a circle; at separations of tens of kilometres what it
//! neglects, `rho^2 / R`, is larger than any real drift.
//!
//! The smallest velocity change that gives the deputy a wanted energy is along its own inertial velocity (the gradient of
//! the kinetic energy): `|v|^2 -> |v|^2 + 2 (E_wanted - E_deputy)`.
//!
//! For linearised models the same statement to first order, with `E = v^2/2 - mu/r`:
//!
//! ```text
//! dE = v_c . (rho' + w x rho) + mu/r_c^2 x,      dv = -dE/|v_c|^2 v_c
//! ```
//!
//! On a circle `dE = n a (y' + 2 n x)`, which is (2.31).
//!
//! # With J2
//!
//! Equal energies are not enough: an orbit of another inclination or eccentricity turns its perigee and node at another
//! rate, and its mean anomaly too. Along the track a deputy drifts by the difference of
//!
//! ```text
//! s = dM/dt + dperigee/dt + cos(i_chief) dnode/dt
//!   = n + k (eta (3 c^2 - 1) + 5 c^2 - 1 - 2 c c_chief),   k = 3/4 J2 n (R/p)^2,   c = cos i,   eta^2 = 1 - e^2
//! ```
//!
//! of mean elements ([`crate::mean_elements`]), and `s` equal to the chief's is the condition of Schaub and Alfriend's
//! J2-invariant orbits along the track. The mean semi-major axis follows from the energy, which J2 keeps exactly (the
//! Earth's axis is one of symmetry), so that nothing of it varies within a revolution:
//!
//! ```text
//! E = -mu/(2a) - mu J2 R^2 (3 c^2 - 1) / (4 a^3 eta^3)
//! ```
//!
//! The velocity change is still along the velocity: the cheapest way to another energy. It leaves what it cannot end, the
//! turning of the node (across the track) and of the perigee.
//!
//! Sources: K. T. Alfriend et al., *Spacecraft Formation Flying*, Elsevier 2010, sections 4.4 and 8.1 (energy matching);
//! H. Schaub and K. T. Alfriend, Celestial Mechanics and Dynamical Astronomy 79, 2001; D. Brouwer, Astronomical Journal 64,
//! 1959 (the averaged energy).

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use crate::elements::Elements;
use crate::hill::{HillState, anomaly_rate_rad_s};
use crate::mean_elements;
use crate::orbit_state::OrbitState;
use crate::propagation::Propagator;
use crate::{EARTH_J2, EARTH_MU_M3_S2, EARTH_RADIUS_M};

/// With J2, velocity changes below this are none \[m/s\]: metres a revolution, which the theory to first order leaves (what it
/// asks for varies by 5e-8 m/s along an orbit, near the critical inclination by 4e-5 m/s).
const THEORY_M_S: f64 = 1e-4;

/// The smallest velocity change after which the deputy does not drift along the chief's track, inertial axes \[m/s\].
///
/// Zero where no speed does that (a deputy far above a chief that never comes there).
#[must_use]
pub fn delta_v_eci_m_s(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState) -> Vector3<f64> {
    match propagator {
        Propagator::TwoBody => {
            let short_m2_s2 = propagator.energy_m2_s2(chief) - propagator.energy_m2_s2(deputy);
            with_energy_m_s(deputy, short_m2_s2).unwrap_or_default()
        }
        Propagator::J2 => {
            let wanted_m_s = equal_rates_m_s(chief, deputy).unwrap_or_default();
            if wanted_m_s.norm() < THEORY_M_S { Vector3::zeros() } else { wanted_m_s }
        }
    }
}

/// The velocity change along the velocity that adds this energy \[m^2/s^2\].
fn with_energy_m_s(state: &OrbitState, added_m2_s2: f64) -> Option<Vector3<f64>> {
    let squared = state.velocity_m_s.norm_squared();
    if squared <= 0.0 || squared + 2.0 * added_m2_s2 < 0.0 {
        return None;
    }
    // sqrt(1 + x) - 1 without the cancellation.
    let x = 2.0 * added_m2_s2 / squared;
    Some(state.velocity_m_s * (x / (1.0 + (1.0 + x).sqrt())))
}

/// The velocity change after which both move along the track at one secular rate; `None` where there is no such ellipse.
fn equal_rates_m_s(chief: &OrbitState, deputy: &OrbitState) -> Option<Vector3<f64>> {
    let of_chief = Secular::of(chief)?;
    let mut moved = *deputy;
    // Each step leaves J2 times what was left: three are at the rounding.
    for _ in 0..4 {
        let of_deputy = Secular::of(&moved)?;
        let faster_rad_s = of_deputy.along_rad_s(of_chief.cosine) - of_chief.along_rad_s(of_chief.cosine);
        // dn/dE = -3 / (n a^2).
        let added_m2_s2 =
            faster_rad_s * of_deputy.mean_motion_rad_s * of_deputy.semi_major_axis_m.powi(2) / 3.0;
        moved.velocity_m_s += with_energy_m_s(&moved, added_m2_s2)?;
    }
    Some(moved.velocity_m_s - deputy.velocity_m_s)
}

/// What of an orbit with J2 does not change within a revolution.
struct Secular {
    semi_major_axis_m: f64,
    mean_motion_rad_s: f64,
    /// sqrt(1 - e^2).
    eta: f64,
    /// Of the inclination.
    cosine: f64,
}

impl Secular {
    fn of(state: &OrbitState) -> Option<Self> {
        let osculating = Elements::of(state).ok()?;
        // Near the critical inclination osculating shapes serve: they differ by J2, and so do the rates that J2 makes.
        let shape = mean_elements::mean(&osculating).unwrap_or(osculating);
        let (eta, cosine) = ((1.0 - shape.eccentricity.powi(2)).sqrt(), shape.inclination_rad.cos());
        let energy_m2_s2 = Propagator::J2.energy_m2_s2(state);
        let mut semi_major_axis_m = osculating.semi_major_axis_m;
        for _ in 0..6 {
            let oblateness_m2_s2 =
                EARTH_MU_M3_S2 * EARTH_J2 * EARTH_RADIUS_M.powi(2) * (3.0 * cosine * cosine - 1.0)
                    / (4.0 * (semi_major_axis_m * eta).powi(3));
            semi_major_axis_m = -0.5 * EARTH_MU_M3_S2 / (energy_m2_s2 + oblateness_m2_s2);
        }
        let mean_motion_rad_s = (EARTH_MU_M3_S2 / semi_major_axis_m.powi(3)).sqrt();
        mean_motion_rad_s.is_finite().then_some(Self { semi_major_axis_m, mean_motion_rad_s, eta, cosine })
    }

    /// How fast it moves along the track of a chief whose inclination has this cosine [rad/s].
    fn along_rad_s(&self, of_chief: f64) -> f64 {
        let parameter_m = self.semi_major_axis_m * self.eta * self.eta;
        let k = 0.75 * EARTH_J2 * self.mean_motion_rad_s * (EARTH_RADIUS_M / parameter_m).powi(2);
        let c2 = self.cosine * self.cosine;
        self.mean_motion_rad_s
            + k * (self.eta * (3.0 * c2 - 1.0) + 5.0 * c2 - 1.0 - 2.0 * self.cosine * of_chief)
    }
}

/// Drift of a deputy ahead of its chief along the track [m/revolution]: -3 pi times the difference of the semi-major axes;
/// with J2 that of the secular rates. NaN where J2 has no ellipse to judge by.
#[must_use]
pub fn drift_m_rev(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState) -> f64 {
    if propagator == Propagator::J2 {
        let (Some(of_chief), Some(of_deputy)) = (Secular::of(chief), Secular::of(deputy)) else {
            return f64::NAN;
        };
        let faster_rad_s = of_deputy.along_rad_s(of_chief.cosine) - of_chief.along_rad_s(of_chief.cosine);
        return TAU / of_chief.mean_motion_rad_s * faster_rad_s * of_chief.semi_major_axis_m;
    }
    let [of_chief, of_deputy] = [chief, deputy].map(|state| propagator.energy_m2_s2(state));
    // a = -mu / (2 E): exact, as the energies are close.
    let longer_m = -0.5 * EARTH_MU_M3_S2 * (of_chief - of_deputy) / (of_chief * of_deputy);
    -3.0 * PI * longer_m
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

    /// Means over revolutions of the in-track position, the last less the first, for each revolution \[m\]. The numerical
    /// propagator, which is compared with DOP853, is the judge.
    fn mean_drift_m_rev(chief: &OrbitState, deputy: &OrbitState, period_s: f64) -> f64 {
        let (samples, revolutions) = (60, 15);
        let mut states = [*chief, *deputy];
        let mut means = Vec::new();
        for _ in 0..revolutions {
            let mut along = 0.0;
            for _ in 0..samples {
                along += HillState::of(&states[0], &states[1]).position_m.y / f64::from(samples);
                states = states.map(|s| Propagator::J2.after(&s, period_s / f64::from(samples)).unwrap());
            }
            means.push(along);
        }
        (means[means.len() - 1] - means[0]) / f64::from(revolutions - 1)
    }

    /// From two velocities, energies alone leave half a kilometre a revolution where the inclination differs by 0.25 deg.
    #[test]
    fn with_the_oblateness_a_deputy_of_another_inclination_stays() {
        for (eccentricity, inclination_deg) in
            [(0.0, 51.6), (0.001, 51.6), (0.0, 98.0), (0.05, 51.6), (0.0, 63.4), (0.1, 63.0), (0.0, 5.0)]
        {
            for mean_anomaly_rad in [0.0, 2.5] {
                let inclination_rad = f64::to_radians(inclination_deg);
                let elements = Elements { inclination_rad, ..chief(eccentricity, mean_anomaly_rad) };
                let (start, period_s) = (elements.state(), elements.period_s());
                let (sine, cosine) = (elements.perigee_rad + elements.true_anomaly_rad()).sin_cos();
                // 30 km across the track, furthest where the latitude is.
                let across_m_s = 30e3 * elements.mean_motion_rad_s() * cosine;
                let mut deputy = HillState {
                    position_m: Vector3::new(0.0, 20e3, 30e3 * sine),
                    velocity_m_s: Vector3::new(0.0, 0.1, across_m_s),
                }
                .deputy(&start);
                let (stated, measured) = (
                    drift_m_rev(Propagator::J2, &start, &deputy),
                    mean_drift_m_rev(&start, &deputy, period_s),
                );
                assert!((stated / measured - 1.0).abs() < 0.012, "{elements:?}: {stated} {measured}");
                let mut equal = deputy;
                let short = Propagator::J2.energy_m2_s2(&start) - Propagator::J2.energy_m2_s2(&deputy);
                equal.velocity_m_s += with_energy_m_s(&equal, short).unwrap();
                let equal = mean_drift_m_rev(&start, &equal, period_s).abs();
                deputy.velocity_m_s += delta_v_eci_m_s(Propagator::J2, &start, &deputy);
                let after = mean_drift_m_rev(&start, &deputy, period_s).abs();
                assert!(after < 5.0 && after < 0.02 * equal, "{elements:?}: {after} {equal} m/rev");
                // It is over for good, not for one place of the orbit.
                for k in 0..20 {
                    let time_s = 300.0 * f64::from(k);
                    let [c, d] = [start, deputy].map(|s| Propagator::J2.after(&s, time_s).unwrap());
                    assert_eq!(
                        delta_v_eci_m_s(Propagator::J2, &c, &d),
                        Vector3::zeros(),
                        "{elements:?} {time_s}"
                    );
                }
            }
        }
    }

    #[test]
    fn no_ellipse_has_no_drift_to_take_out() {
        let start = chief(0.0, 0.4).state();
        let leaves = OrbitState { velocity_m_s: start.velocity_m_s * 1.5, ..start };
        assert_eq!(delta_v_eci_m_s(Propagator::J2, &start, &leaves), Vector3::zeros());
        assert!(drift_m_rev(Propagator::J2, &start, &leaves).is_nan());
    }
}
