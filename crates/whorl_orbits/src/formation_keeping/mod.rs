//! Keeping a deputy in its place beside its chief for days: a law that asks for velocity changes, and the thrust that gives
//! them.
//!
//! # The place
//!
//! A formation's place is the difference of mean elements between deputy and chief when it begins ([`Place`]): inclination,
//! node, eccentricity vector and mean latitude. Held constant, they hold the relative orbit: its tilt, its shape and where
//! along the track it lies. How far off a deputy is, is its position relative to the deputy that would be exactly in its
//! place, along the chief's radius, track and orbit normal; the box is a half-width for each.
//!
//! # The law
//!
//! With u the latitude from the node, Gauss' variational equations about a circle say what a small velocity change does:
//!
//! ```text
//! along the track:   d(a)/a = 2 dv/v,   d(e cos w, e sin w) = 2 dv/v (cos u, sin u)
//! across it:         (d(i), sin i d(node)) = dv/v (cos u, sin u)
//! ```
//!
//! So an error of the tilt is corrected once, where its vector points or opposite; one of the eccentricity vector by two
//! thrusts half a revolution apart, whose sum gives the semi-major axis by which what is ahead or behind is worked off until
//! the next pair. A correction is planned when 0.7 of the box would be reached within a revolution (half a one, across), and
//! goes to the far side by 0.5 of it, as the rates of the oblateness are known. The chief does not thrust.
//!
//! # The flight
//!
//! Chief and deputy move by [`Propagator`], each correction as a thrust of finite length about its moment, with falling
//! mass, along the deputy's own radius, track and normal. `thrust_error` is what the law does not know of its thruster.
//!
//! # Assumptions
//! The law knows both orbits exactly; between passes the attitude is free for thrust. Near-circular chiefs, as formations
//! need them ([`crate::formation`]). J2 alone: no drag, no third harmonic.
//!
//! Source: S. D'Amico, *Autonomous formation flying in low earth orbit*, Ph.D. thesis, TU Delft 2010, chapter 2; H. Schaub
//! and J. L. Junkins, *Analytical Mechanics of Space Systems*, chapter 14.

use nalgebra::{SVector, Vector3};
use thiserror::Error;
use whorl_math::unit_or;

use crate::burn::STANDARD_GRAVITY_M_S2;
use crate::elements::OrbitError;
use crate::hill::{HillState, eci_from_hill};
use crate::mean_elements::MeanElementsError;
use crate::orbit_state::OrbitState;
use crate::propagation::{Propagator, oblateness_m_s2, two_body_m_s2};
use crate::runge_kutta::integrate;

mod law;
#[cfg(test)]
mod tests;

pub use law::{Place, holding_m_s_rev};
use law::{Planned, plan};

/// Longest step while it thrusts \[s\].
const STEP_S: f64 = 1.0;
/// Samples of a revolution.
const SAMPLES: f64 = 48.0;

/// How a deputy is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keeper {
    /// The box: half its width along the chief's radius, track and orbit normal \[m\], each > 0.
    pub half_width_m: Vector3<f64>,
    /// Thrust that the law counts on \[N\], > 0.
    pub thrust_n: f64,
    /// By which share the thruster gives more (or less) than that, above -1.
    pub thrust_error: f64,
    /// Mass when keeping begins \[kg\], > 0.
    pub mass_kg: f64,
    /// Gas that there is \[kg\]; without any, the deputy drifts.
    pub gas_kg: f64,
    /// Specific impulse \[s\], > 0.
    pub specific_impulse_s: f64,
    /// How long it is kept \[s\], at least 0.
    pub duration_s: f64,
}

/// Why a deputy cannot be kept.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum KeepingError {
    /// An orbit.
    #[error("{0}")]
    Orbit(#[from] OrbitError),
    /// Its mean elements.
    #[error("{0}")]
    Mean(#[from] MeanElementsError),
    /// A chief so near to the equator that the oblateness moves its node by more than the formation is known.
    #[error(
        "an inclination of {inclination_deg:.3} deg is too near the equator to keep a formation there: its tilt counts from the node, which is \
         not known well enough; allowed: 0.2 to 179.8 deg"
    )]
    Equatorial {
        /// As given \[deg\].
        inclination_deg: f64,
    },
    /// A number of the keeper.
    #[error("{name} = {value} is not valid for formation keeping: {allowed}")]
    Number {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

impl Keeper {
    fn check(&self) -> Result<(), KeepingError> {
        let positive = "a positive number";
        for (name, value, good, allowed) in [
            ("half_width_m, radial", self.half_width_m.x, self.half_width_m.x > 0.0, positive),
            ("half_width_m, along the track", self.half_width_m.y, self.half_width_m.y > 0.0, positive),
            ("half_width_m, across the track", self.half_width_m.z, self.half_width_m.z > 0.0, positive),
            ("thrust_n", self.thrust_n, self.thrust_n > 0.0, positive),
            ("thrust_error", self.thrust_error, self.thrust_error > -1.0, "a number above -1"),
            ("mass_kg", self.mass_kg, self.mass_kg > 0.0, positive),
            (
                "gas_kg",
                self.gas_kg,
                (0.0..self.mass_kg).contains(&self.gas_kg),
                "a number from 0 to below mass_kg",
            ),
            ("specific_impulse_s", self.specific_impulse_s, self.specific_impulse_s > 0.0, positive),
            ("duration_s", self.duration_s, self.duration_s >= 0.0, "0 or more"),
        ] {
            if !(good && value.is_finite()) {
                return Err(KeepingError::Number { name, value, allowed });
            }
        }
        Ok(())
    }

    fn exhaust_m_s(&self) -> f64 {
        STANDARD_GRAVITY_M_S2 * self.specific_impulse_s
    }
}

/// A correction that was flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    /// When it began and ended, after keeping had begun \[s\].
    pub span_s: (f64, f64),
    /// What the law asked for, along the deputy's own radius, track and normal \[m/s\].
    pub asked_m_s: Vector3<f64>,
    /// How much of it the thrust gave \[m/s\], along the same.
    pub given_m_s: Vector3<f64>,
    /// Gas used \[kg\].
    pub gas_kg: f64,
}

/// A moment of the keeping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// After keeping had begun \[s\].
    pub time_s: f64,
    /// Position relative to the chief, along its radius, track and normal \[m\].
    pub relative_hill_m: Vector3<f64>,
    /// Position relative to the deputy's place, along the same \[m\].
    pub off_hill_m: Vector3<f64>,
    /// Velocity change given until then \[m/s\].
    pub given_m_s: f64,
    /// Gas used until then \[kg\].
    pub gas_kg: f64,
}

/// Days of a deputy that is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Forty-eight of each revolution, and the end.
    pub samples: Vec<Sample>,
    /// In the order in which they were flown.
    pub corrections: Vec<Correction>,
    /// Chief and deputy at the end, inertial axes.
    pub end: [OrbitState; 2],
    /// How far off the same deputy would be at the end without any, along the chief's radius, track and normal \[m\].
    pub uncorrected_hill_m: Vector3<f64>,
    /// When the gas came to its end \[s\].
    pub empty_s: Option<f64>,
}

impl Kept {
    /// When it came into the box to stay \[s\]; `None` if it is outside in the end.
    #[must_use]
    pub fn inside_since_s(&self, half_width_m: &Vector3<f64>) -> Option<f64> {
        let outside =
            |s: &Sample| s.off_hill_m.abs().zip_fold(half_width_m, false, |out, off, half| out || off > half);
        let first = self.samples.iter().rposition(outside).map_or(0, |last| last + 1);
        self.samples.get(first).map(|sample| sample.time_s)
    }

    /// The furthest it was off from some time on, along each axis \[m\].
    #[must_use]
    pub fn furthest_m(&self, from_s: f64) -> Vector3<f64> {
        let later = self.samples.iter().filter(|s| s.time_s >= from_s);
        later.fold(Vector3::zeros(), |most, s| most.zip_map(&s.off_hill_m, |m: f64, off| m.max(off.abs())))
    }

    /// What was given and used in all: velocity change \[m/s\] and gas \[kg\].
    #[must_use]
    pub fn spent(&self) -> (f64, f64) {
        self.samples.last().map_or((0.0, 0.0), |s| (s.given_m_s, s.gas_kg))
    }
}

/// Keeps a deputy in its place.
///
/// # Errors
/// A keeper with invalid numbers, an orbit that is no ellipse, J2 near the critical inclination.
pub fn keep(
    propagator: Propagator,
    place: &Place,
    chief: &OrbitState,
    deputy: &OrbitState,
    keeper: &Keeper,
) -> Result<Kept, KeepingError> {
    keeper.check()?;
    let mut craft = Craft {
        propagator,
        keeper,
        chief: *chief,
        deputy: *deputy,
        now_s: 0.0,
        given_m_s: 0.0,
        gas_kg: 0.0,
        empty_s: None,
    };
    let mut kept = Kept {
        samples: Vec::new(),
        corrections: Vec::new(),
        end: [*chief, *deputy],
        uncorrected_hill_m: Vector3::zeros(),
        empty_s: None,
    };
    let sample_s = crate::Elements::of(chief)?.period_s() / SAMPLES;
    let count = (keeper.duration_s / sample_s).ceil() as u64;
    // Out of the plane and in it, the latest first.
    let mut planned: [Vec<Planned>; 2] = [Vec::new(), Vec::new()];
    for k in 0..=count {
        let until_s = (k as f64 * sample_s).min(keeper.duration_s);
        while let Some((asked, channel)) = next_before(&planned, &craft, until_s) {
            if let Some(waiting) = planned.get_mut(channel) {
                waiting.pop();
            }
            let start_s = craft.start_s(&asked);
            craft.coast(start_s.max(craft.now_s))?;
            kept.corrections.extend(craft.thrust(&asked.delta_v_m_s)?);
        }
        craft.coast(until_s)?;
        kept.samples.push(craft.sample(place)?);
        let free = [0, 1].map(|channel: usize| planned.get(channel).is_some_and(Vec::is_empty));
        let new = plan(
            propagator,
            (place, &keeper.half_width_m),
            (craft.now_s, &craft.chief, &craft.deputy),
            free,
        )?;
        for (waiting, mut more) in planned.iter_mut().zip(new) {
            more.reverse();
            waiting.extend(more);
        }
    }
    let alone = propagator.after(deputy, craft.now_s)?;
    kept.empty_s = craft.empty_s;
    kept.end = [craft.chief, craft.deputy];
    kept.uncorrected_hill_m = off_hill_m(propagator, place, &craft.chief, &alone)?;
    Ok(kept)
}

/// The next correction that begins before a time, and which of the two it is of.
fn next_before(planned: &[Vec<Planned>; 2], craft: &Craft<'_>, until_s: f64) -> Option<(Planned, usize)> {
    let next = planned.iter().enumerate().filter_map(|(channel, p)| Some((*p.last()?, channel)));
    next.min_by(|a, b| a.0.middle_s.total_cmp(&b.0.middle_s)).filter(|(p, _)| craft.start_s(p) < until_s)
}

fn off_hill_m(
    propagator: Propagator,
    place: &Place,
    chief: &OrbitState,
    deputy: &OrbitState,
) -> Result<Vector3<f64>, KeepingError> {
    Ok(HillState::of(chief, deputy).position_m - place.relative(propagator, chief)?.position_m)
}

/// Chief and deputy on their way.
struct Craft<'a> {
    propagator: Propagator,
    keeper: &'a Keeper,
    chief: OrbitState,
    deputy: OrbitState,
    now_s: f64,
    given_m_s: f64,
    gas_kg: f64,
    empty_s: Option<f64>,
}

impl Craft<'_> {
    fn mass_kg(&self) -> f64 {
        self.keeper.mass_kg - self.gas_kg
    }

    /// How long the law's thruster takes: Tsiolkovsky's equation \[s\].
    fn length_s(&self, delta_v_m_s: f64) -> f64 {
        let exhaust_m_s = self.keeper.exhaust_m_s();
        -self.mass_kg() * (-delta_v_m_s / exhaust_m_s).exp_m1() * exhaust_m_s / self.keeper.thrust_n
    }

    fn start_s(&self, planned: &Planned) -> f64 {
        planned.middle_s - 0.5 * self.length_s(planned.delta_v_m_s.norm())
    }

    fn coast(&mut self, until_s: f64) -> Result<(), OrbitError> {
        let length_s = until_s - self.now_s;
        if length_s > 0.0 {
            for state in [&mut self.chief, &mut self.deputy] {
                *state = self.propagator.after(state, length_s)?;
            }
            self.now_s = until_s;
        }
        Ok(())
    }

    /// Thrusts; `None` without gas.
    fn thrust(&mut self, asked_m_s: &Vector3<f64>) -> Result<Option<Correction>, OrbitError> {
        let thrust_n = self.keeper.thrust_n * (1.0 + self.keeper.thrust_error);
        let gas_rate_kg_s = thrust_n / self.keeper.exhaust_m_s();
        let wanted_s = self.length_s(asked_m_s.norm());
        let lasts_s = (self.keeper.gas_kg - self.gas_kg) / gas_rate_kg_s;
        if self.empty_s.is_some() || lasts_s <= 0.0 {
            self.empty_s = self.empty_s.or(Some(self.now_s));
            return Ok(None);
        }
        let length_s = wanted_s.min(lasts_s);
        let direction = unit_or(*asked_m_s, Vector3::y_axis()).into_inner();
        let propagator = self.propagator;
        let mut x = SVector::<f64, 7>::zeros();
        x.fixed_rows_mut::<6>(0).copy_from(&self.deputy.vector());
        x[6] = self.mass_kg();
        let end = integrate(x, length_s, STEP_S, |x| {
            let state = OrbitState::from_vector(&x.fixed_rows::<6>(0).into_owned());
            let mut gravity = two_body_m_s2(&state.position_m);
            if propagator == Propagator::J2 {
                gravity += oblateness_m_s2(&state.position_m);
            }
            let thrust = eci_from_hill(&state) * direction * (thrust_n / x[6]);
            let mut rate = SVector::<f64, 7>::zeros();
            rate.fixed_rows_mut::<3>(0).copy_from(&state.velocity_m_s);
            rate.fixed_rows_mut::<3>(3).copy_from(&(gravity + thrust));
            rate[6] = -gas_rate_kg_s;
            rate
        });
        let gas_kg = x[6] - end[6];
        let given_m_s = self.keeper.exhaust_m_s() * (x[6] / end[6]).ln();
        self.deputy = OrbitState::from_vector(&end.fixed_rows::<6>(0).into_owned());
        self.chief = self.propagator.after(&self.chief, length_s)?;
        let span_s = (self.now_s, self.now_s + length_s);
        self.now_s = span_s.1;
        if length_s < wanted_s {
            self.empty_s = Some(self.now_s);
        }
        self.gas_kg += gas_kg;
        self.given_m_s += given_m_s;
        Ok(Some(Correction { span_s, asked_m_s: *asked_m_s, given_m_s: direction * given_m_s, gas_kg }))
    }

    fn sample(&self, place: &Place) -> Result<Sample, KeepingError> {
        let off_hill_m = off_hill_m(self.propagator, place, &self.chief, &self.deputy)?;
        let relative_hill_m = HillState::of(&self.chief, &self.deputy).position_m;
        Ok(Sample {
            time_s: self.now_s,
            relative_hill_m,
            off_hill_m,
            given_m_s: self.given_m_s,
            gas_kg: self.gas_kg,
        })
    }
}
