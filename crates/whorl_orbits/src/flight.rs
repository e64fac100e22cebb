//! The wanted velocity changes, flown: a spacecraft's thrust goes where its attitude points it, and moves its orbit.
//!
//! # Equations
//!
//! From the start of its burn a spacecraft of mass m thrusts with F. At every moment its attitude is that of the pass
//! ([`crate::co_observation::pointing`]), so the thrust is off the wanted direction by what the boresight leaves:
//!
//! ```text
//! dv/dt = g(r) + F / (m0 - q t) R(t) b,   q = F / (g0 Isp)
//! ```
//!
//! b the velocity change of the thruster in body axes. It ends when the length of what was wanted at its start has been
//! given: t = (m0 / q) (1 - exp(-|dv| q / F)), Tsiolkovsky's equation. What was given across the wanted direction
//! changes the orbit all the same, and what is wanted afterwards says so.
//!
//! Between burns every spacecraft moves by the propagator of the pass. Source of the coupling: Schwartz 2004, section 2.3,
//! which asks for it and assumes the velocity change as given.

use nalgebra::Vector3;

use crate::burn::Burn;
use crate::hill::eci_from_hill;
use crate::orbit_state::OrbitState;
use crate::pass::{Pass, PassError, RelativeModel, Sight};
use crate::propagation::{Propagator, oblateness_m_s2, two_body_m_s2};

/// Longest step while somebody thrusts \[s\].
const STEP_S: f64 = 1.0;
/// A burn that was flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// Which spacecraft.
    pub spacecraft: usize,
    /// When it began and ended, after the epoch \[s\].
    pub span_s: (f64, f64),
    /// What was wanted at its start, Hill axes of that moment \[m/s\].
    pub wanted_hill_m_s: Vector3<f64>,
    /// What the thrust gave, in the Hill axes of each moment \[m/s\].
    pub given_hill_m_s: Vector3<f64>,
    /// Gas used \[kg\].
    pub gas_kg: f64,
    /// Drift along the chief's track, ahead when positive, before and after [m/revolution] ([`crate::drift::drift_m_rev`]).
    pub drift_m_rev: (f64, f64),
}

/// From one beginning or end of a burn to the next.
#[derive(Debug, Clone, PartialEq)]
struct Leg {
    from_s: f64,
    states: Vec<OrbitState>,
    /// Burns that go on.
    thrusts: Vec<Option<Burn>>,
    /// Whether the burn of each spacecraft is over.
    done: Vec<bool>,
}

/// A pass with its burns.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight<'a> {
    pass: &'a Pass,
    legs: Vec<Leg>,
    flown: Vec<Flown>,
}

impl<'a> Flight<'a> {
    /// Flies all burns of a pass.
    ///
    /// # Errors
    /// An invalid pass or burn; a model in which single spacecraft have no orbit of their own.
    pub fn new(pass: &'a Pass) -> Result<Self, PassError> {
        let burns: Vec<Option<Burn>> = pass.spacecraft.iter().map(|s| s.burn).collect();
        if burns.iter().all(Option::is_none) {
            return Ok(Self { pass, legs: Vec::new(), flown: Vec::new() });
        }
        burns.iter().flatten().try_for_each(check)?;
        if !matches!(pass.model, RelativeModel::TwoBody | RelativeModel::J2) {
            return Err(PassError::ThrustWithoutOrbits);
        }
        let count = burns.len();
        let first = Leg {
            from_s: 0.0,
            states: pass.unperturbed(0.0)?.1,
            thrusts: vec![None; count],
            done: vec![false; count],
        };
        let mut flight = Self { pass, legs: vec![first], flown: Vec::new() };
        let mut given = vec![Vector3::zeros(); count];
        let mut ends = vec![f64::INFINITY; count];
        loop {
            let Some(leg) = flight.legs.last() else { return Ok(flight) };
            // The next to begin or to end.
            let next = (0..count).filter_map(|k| {
                let at_s = match (leg.done.get(k)?, leg.thrusts.get(k)?) {
                    (true, _) => return None,
                    (false, Some(_)) => *ends.get(k)?,
                    (false, None) => burns.get(k)?.as_ref()?.start_s,
                };
                Some((at_s.max(leg.from_s), k))
            });
            let Some((at_s, k)) = next.min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(flight) };
            let states = flight.states_within(leg, at_s, &mut given)?;
            let mut leg = Leg { from_s: at_s, states, ..leg.clone() };
            flight.turn(&mut leg, k, &mut given, &mut ends)?;
            flight.legs.push(leg);
        }
    }

    /// Begins or ends the burn of a spacecraft at the beginning of a leg.
    fn turn(
        &mut self,
        leg: &mut Leg,
        k: usize,
        given: &mut [Vector3<f64>],
        ends: &mut [f64],
    ) -> Result<(), PassError> {
        let (chief, _) = self.pass.unperturbed(leg.from_s)?;
        let propagator = self.pass.propagator();
        let (Some(state), Some(spacecraft)) = (leg.states.get(k), self.pass.spacecraft.get(k)) else {
            return Ok(());
        };
        let drift = crate::drift::drift_m_rev(propagator, &chief, state);
        let (Some(thrust), Some(done)) = (leg.thrusts.get_mut(k), leg.done.get_mut(k)) else { return Ok(()) };
        if thrust.take().is_some() {
            *done = true;
            if let Some(flown) = self.flown.iter_mut().find(|flown| flown.spacecraft == k) {
                flown.given_hill_m_s = given.get(k).copied().unwrap_or_default();
                flown.drift_m_rev.1 = drift;
            }
            return Ok(());
        }
        let Some(burn) = spacecraft.burn else { return Ok(()) };
        let wanted_eci = self.pass.wanted_eci_m_s(spacecraft.wanted, &chief, state);
        let wanted_hill_m_s = eci_from_hill(&chief).inverse() * wanted_eci;
        let size_m_s = wanted_hill_m_s.norm();
        let end_s = leg.from_s + burn.duration_s(size_m_s);
        self.flown.push(Flown {
            spacecraft: k,
            span_s: (leg.from_s, end_s),
            wanted_hill_m_s,
            given_hill_m_s: Vector3::zeros(),
            gas_kg: burn.gas_kg(size_m_s),
            drift_m_rev: (drift, drift),
        });
        if size_m_s > 0.0 {
            *thrust = Some(burn);
            if let Some(end) = ends.get_mut(k) {
                *end = end_s;
            }
        } else {
            *done = true;
        }
        Ok(())
    }

    /// The burns, in the order in which they began.
    #[must_use]
    pub fn flown(&self) -> &[Flown] {
        &self.flown
    }

    /// Every spacecraft at a time after the epoch \[s\].
    ///
    /// # Errors
    /// As [`Pass::at`].
    pub fn at(&self, time_s: f64) -> Result<Vec<Sight>, PassError> {
        let (chief, unperturbed) = self.pass.unperturbed(time_s)?;
        let Some(leg) = self.legs.iter().rev().find(|leg| leg.from_s <= time_s) else {
            let wanted = |k: usize, state: &OrbitState| {
                let spacecraft = self.pass.spacecraft.get(k);
                spacecraft.map_or_else(Vector3::zeros, |s| self.pass.wanted_eci_m_s(s.wanted, &chief, state))
            };
            return self.pass.sights(time_s, &chief, &unperturbed, wanted);
        };
        let states = self.states_within(leg, time_s, &mut vec![Vector3::zeros(); leg.states.len()])?;
        self.pass.sights(time_s, &chief, &states, |k, state| self.wanted(k, leg, &chief, state))
    }

    /// What a spacecraft wants, inertial axes \[m/s\]. While it thrusts and afterwards that is what it wanted when its
    /// burn began, so that its attitude does not jump.
    fn wanted(&self, k: usize, leg: &Leg, chief: &OrbitState, state: &OrbitState) -> Vector3<f64> {
        let Some(spacecraft) = self.pass.spacecraft.get(k) else { return Vector3::zeros() };
        let begun = leg.done.get(k) == Some(&true) || leg.thrusts.get(k).is_some_and(Option::is_some);
        match self.flown.iter().find(|flown| begun && flown.spacecraft == k) {
            Some(flown) => eci_from_hill(chief) * flown.wanted_hill_m_s,
            None => self.pass.wanted_eci_m_s(spacecraft.wanted, chief, state),
        }
    }

    /// States at a time within a leg; what thrust gives until then is added to `given`, Hill axes \[m/s\].
    fn states_within(
        &self,
        leg: &Leg,
        time_s: f64,
        given: &mut [Vector3<f64>],
    ) -> Result<Vec<OrbitState>, PassError> {
        let propagator = self.pass.propagator();
        let length_s = time_s - leg.from_s;
        if leg.thrusts.iter().all(Option::is_none) {
            let after = |state| propagator.after(state, length_s).map_err(PassError::from);
            return leg.states.iter().map(after).collect();
        }
        let mut states = leg.states.clone();
        let steps = (length_s / STEP_S).ceil().max(1.0);
        let h = length_s / steps;
        for k in 0..steps as u64 {
            let at_s = leg.from_s + k as f64 * h;
            let rates = |after_s: f64, states: &[OrbitState]| self.rates(leg, at_s + after_s, states);
            let k1 = rates(0.0, &states)?;
            let k2 = rates(0.5 * h, &moved(&states, &k1, 0.5 * h))?;
            let k3 = rates(0.5 * h, &moved(&states, &k2, 0.5 * h))?;
            let k4 = rates(h, &moved(&states, &k3, h))?;
            for (sum, weight) in [(&k1, 1.0), (&k2, 2.0), (&k3, 2.0), (&k4, 1.0)] {
                states = moved(&states, sum, weight * h / 6.0);
                for (given, rate) in given.iter_mut().zip(sum) {
                    *given += rate.thrust_hill_m_s2 * (weight * h / 6.0);
                }
            }
        }
        Ok(states)
    }

    /// How states change while somebody thrusts.
    fn rates(&self, leg: &Leg, time_s: f64, states: &[OrbitState]) -> Result<Vec<Rate>, PassError> {
        let (chief, _) = self.pass.unperturbed(time_s)?;
        let sights = self.pass.sights(time_s, &chief, states, |k, s| self.wanted(k, leg, &chief, s))?;
        let to_hill = eci_from_hill(&chief).inverse();
        let each = states.iter().zip(&sights).enumerate();
        Ok(each
            .map(|(k, (state, sight))| {
                let mut thrust = Vector3::zeros();
                if let (Some(Some(burn)), Some(spacecraft)) =
                    (leg.thrusts.get(k), self.pass.spacecraft.get(k))
                {
                    let start_s =
                        self.flown.iter().find(|f| f.spacecraft == k).map_or(time_s, |f| f.span_s.0);
                    let direction = sight.pointing.q_eci_body * spacecraft.mounting.thrust_body.into_inner();
                    thrust = direction * burn.acceleration_m_s2(time_s - start_s);
                }
                let gravity = two_body_m_s2(&state.position_m)
                    + match self.pass.propagator() {
                        Propagator::TwoBody => Vector3::zeros(),
                        Propagator::J2 => oblateness_m_s2(&state.position_m),
                    };
                Rate {
                    velocity_m_s: state.velocity_m_s,
                    acceleration_m_s2: gravity + thrust,
                    thrust_hill_m_s2: to_hill * thrust,
                }
            })
            .collect())
    }
}

/// How the state of one spacecraft changes.
struct Rate {
    velocity_m_s: Vector3<f64>,
    acceleration_m_s2: Vector3<f64>,
    /// The part of its thrust, Hill axes.
    thrust_hill_m_s2: Vector3<f64>,
}

fn moved(states: &[OrbitState], rates: &[Rate], by_s: f64) -> Vec<OrbitState> {
    let each = states.iter().zip(rates);
    each.map(|(state, rate)| OrbitState {
        position_m: state.position_m + rate.velocity_m_s * by_s,
        velocity_m_s: state.velocity_m_s + rate.acceleration_m_s2 * by_s,
    })
    .collect()
}

fn check(burn: &Burn) -> Result<(), PassError> {
    for (name, value, good) in [
        ("start_s", burn.start_s, burn.start_s >= 0.0),
        ("thrust_n", burn.thrust_n, burn.thrust_n > 0.0),
        ("mass_kg", burn.mass_kg, burn.mass_kg > 0.0),
        ("specific_impulse_s", burn.specific_impulse_s, burn.specific_impulse_s > 0.0),
    ] {
        if !(good && value.is_finite()) {
            return Err(PassError::Burn { name, value });
        }
    }
    Ok(())
}

impl Pass {
    /// Every spacecraft at a time after the epoch \[s\], burns included; [`Flight`] gives many times of a pass with burns
    /// at a lower cost.
    ///
    /// # Errors
    /// Why a pass is invalid.
    pub fn at(&self, time_s: f64) -> Result<Vec<Sight>, PassError> {
        Flight::new(self)?.at(time_s)
    }
}
