//! Mean elements: the orbit without what the oblateness adds and takes away within a revolution, and what is left of it,
//! the slow turning of node and perigee.
//!
//! # Equations
//!
//! Brouwer's theory to first order in J2, with Lyddane's variables where it divides by the eccentricity or by the sine
//! of the inclination, as H. Schaub and J. L. Junkins, *Analytical Mechanics of Space Systems*, appendix F, give it.
//! With n the mean motion, p the semi-latus rectum, eta^2 = 1 - e^2, all of mean elements:
//!
//! ```text
//! dnode/dt    = -3/2 J2 n (R/p)^2 cos i
//! dperigee/dt =  3/4 J2 n (R/p)^2 (5 cos^2 i - 1)
//! dM/dt       = n + 3/4 J2 n (R/p)^2 eta (3 cos^2 i - 1)
//! ```
//!
//! A relative orbit is J2-invariant if node and argument of latitude of chief and deputy turn alike (H. Schaub and K. T.
//! Alfriend, Celestial Mechanics and Dynamical Astronomy 79, 2001):
//!
//! ```text
//! d(eta) = -eta/4 tan i d(i),   d(a) = 2 D a d(eta),   D = J2/4 (R/a)^2 eta^-5 (4 + 3 eta) (1 + 5 cos^2 i)
//! ```
//!
//! # Assumptions
//! J2 alone, to first order: some metres in a low orbit. At the critical inclination, 5 cos^2 i = 1, the theory divides
//! by zero.

use std::f64::consts::{PI, TAU};

use thiserror::Error;
use whorl_math::wrap_angle_rad;

use crate::elements::{Elements, OrbitError};
use crate::{EARTH_J2, EARTH_RADIUS_M};

/// Nearer to the critical inclination, as |1 - 5 cos^2 i|, the long-period terms are larger than what they correct.
const CRITICAL: f64 = 0.05;

/// Why there are no mean elements, or no such orbit.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum MeanElementsError {
    /// The orbit itself.
    #[error("{0}")]
    Orbit(#[from] OrbitError),
    /// Near the critical inclination.
    #[error(
        "an inclination of {inclination_deg:.2} deg is too near the critical one, 63.43 or 116.57 deg, for Brouwer's theory"
    )]
    Critical {
        /// As given \[deg\].
        inclination_deg: f64,
    },
    /// A deputy on so round an orbit cannot be J2-invariant.
    #[error(
        "no deputy with this inclination is J2-invariant: its eccentricity's square would be {square:.2e}, below zero; take the other sign of the difference, or a chief of larger eccentricity"
    )]
    TooRound {
        /// What the conditions ask for.
        square: f64,
    },
}

/// Secular rates of mean elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SecularRates {
    /// Of the node [rad/s].
    pub node_rad_s: f64,
    /// Of the argument of perigee [rad/s].
    pub perigee_rad_s: f64,
    /// Of the mean anomaly [rad/s].
    pub mean_anomaly_rad_s: f64,
}

/// Secular rates of an orbit with these mean elements.
#[must_use]
pub fn secular_rates(mean: &Elements) -> SecularRates {
    let (n, cosine) = (mean.mean_motion_rad_s(), mean.inclination_rad.cos());
    let eta = (1.0 - mean.eccentricity * mean.eccentricity).sqrt();
    let k = 0.75 * EARTH_J2 * n * (EARTH_RADIUS_M / mean.parameter_m()).powi(2);
    SecularRates {
        node_rad_s: -2.0 * k * cosine,
        perigee_rad_s: k * (5.0 * cosine * cosine - 1.0),
        mean_anomaly_rad_s: n + k * eta * (3.0 * cosine * cosine - 1.0),
    }
}

/// Mean elements of an orbit that osculates these.
///
/// # Errors
/// Near the critical inclination; no ellipse.
pub fn mean(osculating: &Elements) -> Result<Elements, MeanElementsError> {
    mapped(osculating, -1.0)
}

/// The elements that an orbit with these mean elements osculates.
///
/// # Errors
/// As [`mean`].
pub fn osculating(mean: &Elements) -> Result<Elements, MeanElementsError> {
    mapped(mean, 1.0)
}

/// Mean elements with J2's short-period and long-period changes added (`sign` 1) or taken out (-1).
fn mapped(from: &Elements, sign: f64) -> Result<Elements, MeanElementsError> {
    from.check()?;
    let (a, e, i) = (from.semi_major_axis_m, from.eccentricity, from.inclination_rad);
    let (s, c) = i.sin_cos();
    let c2 = c * c;
    let critical = 1.0 - 5.0 * c2;
    if critical.abs() < CRITICAL {
        return Err(MeanElementsError::Critical { inclination_deg: i.to_degrees() });
    }
    let (omega, mean_anomaly) = (from.perigee_rad, wrap_angle_rad(from.mean_anomaly_rad));
    let f = from.true_anomaly_rad();
    let (sin_f, cos_f) = f.sin_cos();
    let eta2 = 1.0 - e * e;
    let eta = eta2.sqrt();
    let gamma = sign * 0.5 * EARTH_J2 * (EARTH_RADIUS_M / a).powi(2);
    let gamma_p = gamma / (eta2 * eta2);
    // a over r.
    let ratio = (1.0 + e * cos_f) / eta2;
    let turned = |k: f64| (2.0 * omega + k * f).sin_cos();
    let ((sin_0, cos_0), (sin_1, cos_1)) = (turned(0.0), turned(1.0));
    let ((sin_2, cos_2), (sin_3, cos_3)) = (turned(2.0), turned(3.0));

    let semi_major_axis_m = a + a
        * gamma
        * ((3.0 * c2 - 1.0) * (ratio.powi(3) - eta.powi(-3)) + 3.0 * s * s * ratio.powi(3) * cos_2);

    // Long period: divided by 1 - 5 cos^2 i.
    let shape = 1.0 - 11.0 * c2 - 40.0 * c2 * c2 / critical;
    let long_e = gamma_p / 8.0 * e * eta2 * shape * cos_0;
    let powers = 3.0 * cos_f + 3.0 * e * cos_f * cos_f + e * e * cos_f.powi(3);
    let change_e = long_e
        + 0.5
            * eta2
            * (gamma / eta.powi(6)
                * ((3.0 * c2 - 1.0) * (e * eta + e / (1.0 + eta) + powers)
                    + 3.0 * s * s * (e + powers) * cos_2)
                - gamma_p * s * s * (3.0 * cos_1 + cos_3));
    // An equatorial orbit has no long-period change of the inclination: e times long_e goes with sin^2 i there.
    let long_i = if s.abs() < 1e-9 { 0.0 } else { -e * long_e / eta2 * c / s };
    let change_i = long_i + 0.5 * gamma_p * c * s * (3.0 * cos_2 + 3.0 * e * cos_1 + e * cos_3);

    let equation_of_centre = wrap_angle_rad(f - mean_anomaly) + e * sin_f;
    let waves = 3.0 * sin_2 + 3.0 * e * sin_1 + e * sin_3;
    let of_node = 11.0 + 80.0 * c2 / critical + 200.0 * c2 * c2 / (critical * critical);
    let change_node =
        -gamma_p / 8.0 * e * e * c * of_node * sin_0 - 0.5 * gamma_p * c * (6.0 * equation_of_centre - waves);
    let of_sum = 2.0 + e * e
        - 11.0 * (2.0 + 3.0 * e * e) * c2
        - 40.0 * (2.0 + 5.0 * e * e) * c2 * c2 / critical
        - 400.0 * e * e * c2.powi(3) / (critical * critical);
    let sum = mean_anomaly + omega + from.node_rad + gamma_p / 8.0 * eta.powi(3) * shape * sin_0
        - gamma_p / 16.0 * of_sum * sin_0
        + gamma_p / 4.0 * (-6.0 * critical * equation_of_centre + (3.0 - 5.0 * c2) * waves)
        + change_node;
    let q = (ratio * eta).powi(2) + ratio;
    let e_change_m = gamma_p / 8.0 * e * eta.powi(3) * shape * sin_0
        - gamma_p / 4.0
            * eta.powi(3)
            * (2.0 * (3.0 * c2 - 1.0) * (q + 1.0) * sin_f
                + 3.0 * s * s * ((1.0 - q) * sin_1 + (q + 1.0 / 3.0) * sin_3));

    // Lyddane: e and M, i and node as vectors.
    let (sin_m, cos_m) = mean_anomaly.sin_cos();
    let (d1, d2) = ((e + change_e) * sin_m + e_change_m * cos_m, (e + change_e) * cos_m - e_change_m * sin_m);
    let (sin_half, cos_half) = (0.5 * i).sin_cos();
    let (sin_node, cos_node) = from.node_rad.sin_cos();
    let tilt = sin_half + 0.5 * cos_half * change_i;
    let (d3, d4) = (
        tilt * sin_node + sin_half * change_node * cos_node,
        tilt * cos_node - sin_half * change_node * sin_node,
    );
    let (mean_anomaly_rad, node_rad) = (d1.atan2(d2), d3.atan2(d4));
    Ok(Elements {
        semi_major_axis_m,
        eccentricity: d1.hypot(d2),
        inclination_rad: 2.0 * d3.hypot(d4).clamp(0.0, 1.0).asin(),
        node_rad,
        perigee_rad: wrap_angle_rad(sum - mean_anomaly_rad - node_rad),
        mean_anomaly_rad,
    })
}

/// The deputy whose inclination differs by this much \[rad\] and whose relative orbit about the chief is J2-invariant; node,
/// perigee and mean anomaly are the chief's. All elements are mean.
///
/// # Errors
/// Where it would need an eccentricity that there is not.
pub fn j2_invariant(chief: &Elements, inclination_rad: f64) -> Result<Elements, MeanElementsError> {
    chief.check()?;
    let eta = (1.0 - chief.eccentricity * chief.eccentricity).sqrt();
    let (sine, cosine) = chief.inclination_rad.sin_cos();
    let change = -0.25 * eta * sine / cosine * inclination_rad;
    let square = 1.0 - (eta + change).powi(2);
    if !(0.0..1.0).contains(&square) {
        return Err(MeanElementsError::TooRound { square });
    }
    let d = 0.25
        * EARTH_J2
        * (EARTH_RADIUS_M / chief.semi_major_axis_m).powi(2)
        * eta.powi(-5)
        * (4.0 + 3.0 * eta)
        * (1.0 + 5.0 * cosine * cosine);
    let deputy = Elements {
        semi_major_axis_m: chief.semi_major_axis_m * (1.0 + 2.0 * d * change),
        eccentricity: square.sqrt(),
        inclination_rad: chief.inclination_rad + inclination_rad,
        ..*chief
    };
    deputy.check()?;
    Ok(deputy)
}

/// How the oblateness pulls a deputy away from its chief, and what it costs to stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keeping {
    /// Along the track, ahead when positive [m/revolution].
    pub along_m_rev: f64,
    /// Across the track at the equator, from the turning of the node [m/revolution].
    pub across_m_rev: f64,
    /// Of the perigee against the chief's [rad/revolution].
    pub perigee_rad_rev: f64,
    /// Velocity change that holds node and eccentricity vector where they are, in every revolution [m/s].
    pub each_revolution_m_s: f64,
    /// Velocity change that ends the drift along the track, once \[m/s\].
    pub once_m_s: f64,
}

/// How the oblateness pulls a deputy away from its chief; mean elements.
///
/// The node is turned back by a thrust across the orbit where the latitude is largest, dv = v sin i d(node); the
/// eccentricity vector by thrusts along the track half a revolution apart, dv = v |d(e)| / 2; the drift along the track ends
/// with another semi-major axis, dv = n d(a) / 2 (Gauss' variational equations, near-circular).
#[must_use]
pub fn keeping(chief: &Elements, deputy: &Elements) -> Keeping {
    let [of_chief, of_deputy] = [chief, deputy].map(secular_rates);
    let (period_s, speed_m_s) = (chief.period_s(), chief.mean_motion_rad_s() * chief.semi_major_axis_m);
    let node = (of_deputy.node_rad_s - of_chief.node_rad_s) * period_s;
    let perigee = (of_deputy.perigee_rad_s - of_chief.perigee_rad_s) * period_s;
    let anomaly = (of_deputy.mean_anomaly_rad_s - of_chief.mean_anomaly_rad_s) * period_s;
    let (sine, cosine) = chief.inclination_rad.sin_cos();
    let along_m_rev = chief.semi_major_axis_m * (anomaly + perigee + cosine * node);
    // The deputy's eccentricity vector against the chief's, whose own turning every satellite shares.
    let turned = deputy.eccentricity * perigee;
    Keeping {
        along_m_rev,
        across_m_rev: chief.semi_major_axis_m * sine * node,
        perigee_rad_rev: perigee,
        each_revolution_m_s: speed_m_s * (sine * node.abs() + 0.5 * turned.abs()),
        once_m_s: (along_m_rev / (3.0 * PI)).abs() * 0.5 * TAU / period_s,
    }
}

/// How evenly the cost is shared: the largest over the mean; 1: all spend the same, and the gas of all ends together.
#[must_use]
pub fn imbalance(costs_m_s: &[f64]) -> f64 {
    let mean = costs_m_s.iter().sum::<f64>() / (costs_m_s.len() as f64).max(1.0);
    if mean > 0.0 { costs_m_s.iter().copied().fold(0.0, f64::max) / mean } else { 1.0 }
}
