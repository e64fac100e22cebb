//! Which corrections keep a deputy in its place, and when.

use std::f64::consts::{PI, TAU};

use nalgebra::{Vector2, Vector3};
use whorl_math::wrap_angle_rad;

use super::KeepingError;
use crate::drift::drift_m_rev;
use crate::elements::Elements;
use crate::hill::HillState;
use crate::mean_elements::{self, SecularRates, secular_rates};
use crate::orbit_state::OrbitState;
use crate::propagation::Propagator;

/// Share of what is allowed beyond which a correction is planned.
const ACT: f64 = 0.7;
/// Share of what is allowed by which a correction goes beyond the middle, against what pulls the deputy away.
const BEYOND: f64 = 0.5;
/// Revolutions over which an error along the track may be worked off: the least and the most.
const COAST: (f64, f64) = (1.0, 15.0);
/// Sine of the inclination below which the node is not known: what the mean elements leave, metres, turns the tilt of a formation by a
/// hundredth of itself there.
const LEAST_TILT: f64 = 3.4e-3;
/// Corrections below this are left out \[m/s\]: no thruster gives them.
const LEAST_M_S: f64 = 1e-5;

/// A deputy's place beside its chief, as differences of mean elements that a formation holds constant.
///
/// Node and perigee of a retrograde orbit turn against each other as it comes near to the equator, and their sum, which stays
/// known there on a prograde one, does not. So retrograde orbits are seen in a mirror that holds the Earth's axis, `y -> -y`: they
/// are prograde there, and oblateness is the same. Along radius and track nothing changes; across the track signs do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Of perigee plus mean anomaly \[rad\].
    pub latitude_rad: f64,
    /// Of the node \[rad\].
    pub node_rad: f64,
    /// Of the inclination \[rad\].
    pub inclination_rad: f64,
    /// Of (e cos(perigee), e sin(perigee)).
    pub eccentricity: Vector2<f64>,
    /// Whether these are elements of the orbits as they are in the mirror.
    pub mirrored: bool,
}

/// The orbit in the mirror, or itself.
fn seen(mirrored: bool, state: &OrbitState) -> OrbitState {
    let turned = |v: &Vector3<f64>| if mirrored { Vector3::new(v.x, -v.y, v.z) } else { *v };
    OrbitState { position_m: turned(&state.position_m), velocity_m_s: turned(&state.velocity_m_s) }
}

/// A vector along radius, track and normal as it is before the mirror.
fn before(mirrored: bool, v: Vector3<f64>) -> Vector3<f64> {
    if mirrored { Vector3::new(v.x, v.y, -v.z) } else { v }
}

/// Mean elements; in two-body motion the elements themselves.
fn mean(propagator: Propagator, state: &OrbitState) -> Result<Elements, KeepingError> {
    let osculating = Elements::of(state)?;
    Ok(match propagator {
        Propagator::TwoBody => osculating,
        Propagator::J2 => mean_elements::mean(&osculating)?,
    })
}

fn rates(propagator: Propagator, mean: &Elements) -> SecularRates {
    match propagator {
        Propagator::TwoBody => {
            SecularRates { node_rad_s: 0.0, perigee_rad_s: 0.0, mean_anomaly_rad_s: mean.mean_motion_rad_s() }
        }
        Propagator::J2 => secular_rates(mean),
    }
}

fn vector(elements: &Elements) -> Vector2<f64> {
    let (sine, cosine) = elements.perigee_rad.sin_cos();
    Vector2::new(cosine, sine) * elements.eccentricity
}

impl Place {
    /// Of a deputy beside its chief.
    ///
    /// # Errors
    /// No ellipse; J2 near the critical inclination, or within 0.2 deg of the equator.
    pub fn of(propagator: Propagator, chief: &OrbitState, deputy: &OrbitState) -> Result<Self, KeepingError> {
        let inclination_rad = Elements::of(chief)?.inclination_rad;
        if propagator == Propagator::J2 && inclination_rad.sin() < LEAST_TILT {
            return Err(KeepingError::Equatorial { inclination_deg: inclination_rad.to_degrees() });
        }
        let mirrored = chief.position_m.cross(&chief.velocity_m_s).z < 0.0;
        let [chief, deputy] = [chief, deputy].map(|state| mean(propagator, &seen(mirrored, state)));
        Ok(Self::between(&chief?, &deputy?, mirrored))
    }

    fn between(chief: &Elements, deputy: &Elements, mirrored: bool) -> Self {
        let latitude = |e: &Elements| e.perigee_rad + e.mean_anomaly_rad;
        Self {
            latitude_rad: wrap_angle_rad(latitude(deputy) - latitude(chief)),
            node_rad: wrap_angle_rad(deputy.node_rad - chief.node_rad),
            inclination_rad: deputy.inclination_rad - chief.inclination_rad,
            eccentricity: vector(deputy) - vector(chief),
            mirrored,
        }
    }

    /// Where the deputy belongs beside a chief in this state, without drift along the track.
    ///
    /// # Errors
    /// As [`Place::of`].
    pub fn relative(&self, propagator: Propagator, chief: &OrbitState) -> Result<HillState, KeepingError> {
        let chief = mean(propagator, &seen(self.mirrored, chief))?;
        let q = vector(&chief) + self.eccentricity;
        let perigee_rad = q.y.atan2(q.x);
        let mut deputy = Elements {
            semi_major_axis_m: chief.semi_major_axis_m,
            eccentricity: q.norm(),
            inclination_rad: chief.inclination_rad + self.inclination_rad,
            node_rad: chief.node_rad + self.node_rad,
            perigee_rad,
            mean_anomaly_rad: chief.perigee_rad + chief.mean_anomaly_rad + self.latitude_rad - perigee_rad,
        };
        let [of_chief, of_deputy] = [chief, deputy].map(|e| rates(propagator, &e));
        let along = |r: &SecularRates| {
            r.mean_anomaly_rad_s + r.perigee_rad_s + chief.inclination_rad.cos() * r.node_rad_s
        };
        // dn = -3/2 n/a da.
        let faster = (along(&of_deputy) - along(&of_chief)) / chief.mean_motion_rad_s();
        deputy.semi_major_axis_m *= 1.0 + faster / 1.5;
        // Both by the same map: what the theory leaves of one, metres, it leaves of the other.
        let state = |mean: &Elements| match propagator {
            Propagator::TwoBody => Ok(mean.state()),
            Propagator::J2 => mean_elements::osculating(mean).map(|elements| elements.state()),
        };
        let HillState { position_m, velocity_m_s } = HillState::of(&state(&chief)?, &state(&deputy)?);
        Ok(HillState {
            position_m: before(self.mirrored, position_m),
            velocity_m_s: before(self.mirrored, velocity_m_s),
        })
    }
}

/// A correction that is planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Planned {
    /// Its middle \[s\].
    pub middle_s: f64,
    /// Along the deputy's own radius, track and orbit normal \[m/s\].
    pub delta_v_m_s: Vector3<f64>,
}

/// How far a deputy is from its place, and what pulls it further; angles are of the orbit, so that the semi-major axis times
/// them are metres.
struct Off {
    semi_major_axis_m: f64,
    period_s: f64,
    speed_m_s: f64,
    /// Of the inclination, and of the node times the inclination's sine \[rad\].
    tilt: Vector2<f64>,
    tilt_rate_s: Vector2<f64>,
    eccentricity: Vector2<f64>,
    eccentricity_rate_s: Vector2<f64>,
    /// Ahead \[rad\], and how that grows [rad/revolution].
    ahead_rad: f64,
    drift_rad_rev: f64,
    /// Perigee plus true anomaly of the deputy \[rad\].
    latitude_rad: f64,
}

impl Off {
    fn of(
        propagator: Propagator,
        place: &Place,
        chief: &OrbitState,
        deputy: &OrbitState,
    ) -> Result<Self, KeepingError> {
        let [chief, deputy] = [chief, deputy].map(|state| seen(place.mirrored, state));
        let [mean_c, mean_d] = [mean(propagator, &chief)?, mean(propagator, &deputy)?];
        let now = Place::between(&mean_c, &mean_d, place.mirrored);
        let [of_chief, of_deputy] = [mean_c, mean_d].map(|e| rates(propagator, &e));
        let (sine, cosine) = mean_c.inclination_rad.sin_cos();
        let node_rad = wrap_angle_rad(now.node_rad - place.node_rad);
        let turning = |e: &Elements, r: &SecularRates| {
            let q = vector(e);
            Vector2::new(-q.y, q.x) * r.perigee_rad_s
        };
        let osculating = Elements::of(&deputy)?;
        Ok(Self {
            semi_major_axis_m: mean_c.semi_major_axis_m,
            period_s: mean_c.period_s(),
            speed_m_s: mean_c.mean_motion_rad_s() * mean_c.semi_major_axis_m,
            tilt: Vector2::new(now.inclination_rad - place.inclination_rad, sine * node_rad),
            tilt_rate_s: Vector2::new(0.0, sine * (of_deputy.node_rad_s - of_chief.node_rad_s)),
            eccentricity: now.eccentricity - place.eccentricity,
            eccentricity_rate_s: turning(&mean_d, &of_deputy) - turning(&mean_c, &of_chief),
            ahead_rad: wrap_angle_rad(now.latitude_rad - place.latitude_rad) + cosine * node_rad,
            drift_rad_rev: drift_m_rev(propagator, &chief, &deputy) / mean_c.semi_major_axis_m,
            latitude_rad: osculating.perigee_rad + osculating.true_anomaly_rad(),
        })
    }

    /// When the deputy is next where this vector points, or opposite: time from now \[s\] and the sign.
    fn next(&self, direction: &Vector2<f64>) -> (f64, f64) {
        let ahead_rad = (direction.y.atan2(direction.x) - self.latitude_rad).rem_euclid(TAU);
        if ahead_rad < PI {
            (ahead_rad / TAU * self.period_s, 1.0)
        } else {
            ((ahead_rad - PI) / TAU * self.period_s, -1.0)
        }
    }

    /// What to change an error by that a rate makes, so that it begins on the far side: the change, where its middle is due
    /// after `later_s` more than the next place, and that time and sign.
    fn change(
        &self,
        error: &Vector2<f64>,
        rate_s: &Vector2<f64>,
        allowed: f64,
        later_s: f64,
    ) -> (Vector2<f64>, f64, f64) {
        let ahead_s = if rate_s.norm() > 0.0 { BEYOND * allowed / rate_s.norm() } else { 0.0 };
        let ahead_s = ahead_s.min(COAST.1 * self.period_s);
        let (mut after_s, mut sign) = (0.25 * self.period_s, 1.0);
        let mut change = Vector2::zeros();
        for _ in 0..3 {
            change = -(error + rate_s * (after_s + later_s + ahead_s));
            (after_s, sign) = self.next(&change);
        }
        (change, after_s, sign)
    }
}

/// The corrections that are due, from what is known now. `free` says for out of the plane and in it whether none is planned.
pub(super) fn plan(
    propagator: Propagator,
    (place, half_width_m): (&Place, &Vector3<f64>),
    (now_s, chief, deputy): (f64, &OrbitState, &OrbitState),
    free: [bool; 2],
) -> Result<[Vec<Planned>; 2], KeepingError> {
    let off = Off::of(propagator, place, chief, deputy)?;
    let a = off.semi_major_axis_m;
    let [mut across, mut within] = [Vec::new(), Vec::new()];
    let allowed = half_width_m.z / a;
    if free[0] && (off.tilt + off.tilt_rate_s * (0.5 * off.period_s)).norm() > ACT * allowed {
        let (change, after_s, sign) = off.change(&off.tilt, &off.tilt_rate_s, allowed, 0.0);
        across.push(Planned {
            middle_s: now_s + after_s,
            delta_v_m_s: before(place.mirrored, Vector3::z() * (sign * off.speed_m_s * change.norm())),
        });
    }
    // Along the track half is for the eccentricity: its waves, twice those of the radius, and what is ahead between the two
    // thrusts of a pair. The other half is for being ahead or behind.
    let allowed = half_width_m.x.min(0.2 * half_width_m.y) / a;
    let ahead_allowed = 0.5 * half_width_m.y / a;
    let waves = (off.eccentricity + off.eccentricity_rate_s * off.period_s).norm() > ACT * allowed;
    if free[1] && (waves || (off.ahead_rad + off.drift_rad_rev).abs() > ACT * ahead_allowed) {
        let rate = off.eccentricity_rate_s;
        let (change, after_s, sign) = off.change(&off.eccentricity, &rate, allowed, 0.25 * off.period_s);
        // Two thrusts half a revolution apart: their difference changes the eccentricity, their sum the semi-major axis, so
        // that what is ahead is worked off until the next pair (D'Amico 2010, section 2.4). All of it in shares of a.
        let change = if waves { change } else { Vector2::zeros() };
        let longer = -off.drift_rad_rev / (3.0 * PI);
        // From when this pair is over to when the next one begins, which is planned a revolution ahead.
        let lasts =
            if rate.norm() > 0.0 { (ACT + BEYOND) * allowed / rate.norm() / off.period_s } else { COAST.1 };
        let until = (lasts - 0.5).clamp(COAST.0, COAST.1);
        // Between the two the deputy is on the other semi-major axis, which moves it along the track, and the next pair's
        // difference will move it alike: half of that is left for it, so that it stays about the middle.
        let moved = -0.75 * PI * sign * change.norm();
        let ahead = off.ahead_rad + off.drift_rad_rev * after_s / off.period_s;
        let wanted = (ahead - 0.75 * PI * longer + 1.5 * moved) / (3.0 * PI * until + 0.75 * PI);
        let (sum, difference) = (0.5 * (wanted - longer), 0.5 * sign * change.norm());
        for (later, share) in [(0.0, 0.5 * (sum + difference)), (0.5, 0.5 * (sum - difference))] {
            within.push(Planned {
                middle_s: now_s + after_s + later * off.period_s,
                delta_v_m_s: Vector3::y() * (off.speed_m_s * share),
            });
        }
    }
    for planned in [&mut across, &mut within] {
        planned.retain(|p| p.delta_v_m_s.norm() > LEAST_M_S);
    }
    Ok([across, within])
}

/// Velocity change that holds a place against the oblateness [m/s/revolution], by Gauss' variational equations about a
/// circle: the node is turned back across the orbit, the eccentricity vector along the track.
///
/// # Errors
/// As [`Place::of`].
pub fn holding_m_s_rev(
    propagator: Propagator,
    place: &Place,
    chief: &OrbitState,
) -> Result<f64, KeepingError> {
    let deputy = place.relative(propagator, chief)?.deputy(chief);
    let off = Off::of(propagator, place, chief, &deputy)?;
    let each_s = off.tilt_rate_s.norm() + 0.5 * off.eccentricity_rate_s.norm();
    Ok(off.speed_m_s * each_s * off.period_s)
}
