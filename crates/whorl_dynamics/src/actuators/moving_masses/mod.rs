//! Linear mass actuators: masses that are moved along the body to change the gravity offset (Schwartz 2004, section 4.1.1:
//! three of them, "up to 30 lb across 8 in").
//!
//! They are commanded by the moment that they shall add to the gravity offset. A platform whose file lists none has ideal
//! ones: any moment, at once. Listed under `moving_masses`, each has an axis, a mass, end stops, a largest speed and
//! play between its spindle and the mass:
//!
//! ```text
//! m g r_cg = (m g r_cg)_0 + sum_i m_i g x_i a_i,     |x_i| <= travel_i,     |ds_i/dt| <= max_speed_i
//! ```
//!
//! with s the spindle's position, and x that of the mass, which is pushed by it and stays where it is left (a play
//! operator of the width `backlash_m`). What is neglected: the momentum of the masses while they move, and what their
//! displacement changes of the inertia.

mod course;
mod dynamics;
#[cfg(test)]
mod tests;

pub use dynamics::State;
pub(crate) use dynamics::{Drive, Forces};

use nalgebra::{Matrix3, Unit, Vector3};
use whorl_math::GRAVITY_M_S2;

use super::kind::{check_count, check_positive};
use super::{ActuatorError, ActuatorKind, Allowed, Field, Group, KindPrior};
use crate::PlatformModel;

/// Masses of a platform at most: one for each direction.
pub const MAX_MASSES: usize = 3;
/// Least volume that the directions of three masses, and least area that those of two, enclose.
const LEAST_SPREAD: f64 = 1.0e-3;

/// A mass on a spindle.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingMass {
    /// Name in parameter files.
    pub name: String,
    /// Direction in which it is moved, body axes.
    pub axis_b: Unit<Vector3<f64>>,
    /// What is moved \[kg\], > 0.
    pub mass_kg: f64,
    /// From the middle to either end stop \[m\], > 0.
    pub travel_m: f64,
    /// Largest speed [m/s], > 0.
    pub max_speed_m_s: f64,
    /// Play between spindle and mass, from one flank to the other \[m\], >= 0.
    pub backlash_m: f64,
}

impl MovingMass {
    /// Moment in a metre of displacement, body axes \[N\].
    fn weight_b_n(&self) -> Vector3<f64> {
        self.axis_b.into_inner() * (self.mass_kg * GRAVITY_M_S2)
    }
}

/// The linear mass actuators of a platform; none: ideal ones.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MovingMasses(pub Vec<MovingMass>);

impl MovingMasses {
    /// Positions of the spindles that give this moment, or, for moments that no positions give, the nearest in each
    /// mass's own direction, within the end stops \[m\]; entries beyond the platform's own masses are zero.
    #[must_use]
    pub fn positions_m(&self, moment_b_n_m: &Vector3<f64>) -> [f64; MAX_MASSES] {
        let mut columns = Matrix3::zeros();
        for (i, mass) in self.0.iter().enumerate().take(MAX_MASSES) {
            columns.set_column(i, &mass.weight_b_n());
        }
        // Masses that are not there have zero columns, and get zero.
        let inverse = columns.pseudo_inverse(LEAST_SPREAD * columns.amax()).unwrap_or_default();
        let wanted = inverse * moment_b_n_m;
        std::array::from_fn(|i| {
            self.0.get(i).map_or(0.0, |mass| wanted[i].max(-mass.travel_m).min(mass.travel_m))
        })
    }

    /// Moment of masses in these positions, body axes [N m].
    #[must_use]
    pub fn moment_b_n_m(&self, position_m: &[f64; MAX_MASSES]) -> Vector3<f64> {
        self.0.iter().zip(position_m).fold(Vector3::zeros(), |sum, (mass, x)| sum + mass.weight_b_n() * *x)
    }

    /// What can be had of a moment within the end stops, body axes [N m]: all of it from ideal masses.
    #[must_use]
    pub fn within_travel(&self, moment_b_n_m: &Vector3<f64>) -> Vector3<f64> {
        if self.0.is_empty() { *moment_b_n_m } else { self.moment_b_n_m(&self.positions_m(moment_b_n_m)) }
    }

    /// Where the masses are `dt_s` later on the way from one moment to another, each at its largest speed, body axes
    /// [N m]. Ideal masses are there at once.
    #[must_use]
    pub fn on_the_way(&self, from_b_n_m: &Vector3<f64>, to_b_n_m: &Vector3<f64>, dt_s: f64) -> Vector3<f64> {
        if self.0.is_empty() {
            return *to_b_n_m;
        }
        let (from_m, to_m) = (self.positions_m(from_b_n_m), self.positions_m(to_b_n_m));
        self.moment_b_n_m(&std::array::from_fn(|i| {
            let reach_m = self.0.get(i).map_or(0.0, |mass| mass.max_speed_m_s * dt_s.max(0.0));
            from_m[i] + (to_m[i] - from_m[i]).max(-reach_m).min(reach_m)
        }))
    }

    /// Play as a moment along each body axis, from one flank to the other [N m].
    #[must_use]
    pub fn play_b_n_m(&self) -> Vector3<f64> {
        let plays = self.0.iter().map(|mass| mass.weight_b_n().abs() * mass.backlash_m);
        plays.fold(Vector3::zeros(), |sum, play| sum + play)
    }

    /// Whether the axes are too close to one line or one plane for every moment between them to have one answer.
    fn are_dependent(&self) -> bool {
        let mut axes = self.0.iter().map(|mass| mass.axis_b.into_inner());
        match (axes.next(), axes.next(), axes.next()) {
            (Some(a), Some(b), Some(c)) => a.cross(&b).dot(&c).abs() < LEAST_SPREAD,
            (Some(a), Some(b), None) => a.cross(&b).norm() < LEAST_SPREAD,
            _ => false,
        }
    }
}

impl ActuatorKind for MovingMasses {
    fn groups(&self) -> &'static [Group] {
        &[Group::Members { name: "moving_masses", defaults: "moving_mass_defaults" }]
    }

    fn add(&mut self, name: String) {
        self.0.push(MovingMass {
            name,
            axis_b: Vector3::z_axis(),
            mass_kg: 0.0,
            travel_m: 0.0,
            max_speed_m_s: 0.0,
            backlash_m: 0.0,
        });
    }

    fn count(&self) -> usize {
        self.0.len()
    }

    fn names(&self) -> Vec<&str> {
        self.0.iter().map(|mass| mass.name.as_str()).collect()
    }

    fn fields(&mut self, _group: usize, member: usize) -> Vec<Field<'_>> {
        use Allowed::{NonNegative, Positive};
        let Some(mass) = self.0.get_mut(member) else { return Vec::new() };
        vec![
            Field::direction("axis", "direction in which the mass is moved, body axes", &mut mass.axis_b),
            Field::number("mass_kg", "mass that is moved", "kg", Positive, &mut mass.mass_kg).shared(),
            Field::number(
                "travel_m",
                "travel from the middle to either end stop",
                "m",
                Positive,
                &mut mass.travel_m,
            )
            .shared(),
            Field::number("max_speed_m_s", "largest speed", "m/s", Positive, &mut mass.max_speed_m_s).shared(),
            Field::number(
                "backlash_m",
                "play between spindle and mass, from one flank to the other",
                "m",
                NonNegative,
                &mut mass.backlash_m,
            )
            .or(0.0)
            .shared(),
        ]
    }

    fn check(&self) -> Result<(), ActuatorError> {
        check_count("moving_masses", self.0.len(), MAX_MASSES)?;
        check_positive(self.0.iter().flat_map(|mass| {
            [
                (mass.mass_kg, "a moving mass's mass"),
                (mass.travel_m, "a moving mass's travel"),
                (mass.max_speed_m_s, "a moving mass's largest speed"),
            ]
        }))?;
        if self.are_dependent() {
            return Err(ActuatorError::Dependent { kind: "moving_masses" });
        }
        Ok(())
    }
}

impl PlatformModel {
    /// Its linear mass actuators; none listed: ideal ones.
    #[must_use]
    pub fn moving_masses(&self) -> &MovingMasses {
        &self.actuators.moving_masses
    }
}

/// They have no uncertainty: their initial position is part of the gravity offset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MovingMassPriors;

impl MovingMassPriors {
    pub(super) fn typical(_masses: &MovingMasses) -> Self {
        Self
    }
}

impl KindPrior for MovingMassPriors {
    fn keys(&self) -> &'static [&'static str] {
        &[]
    }

    fn stddevs(&self, _key: &str) -> Option<&[f64]> {
        None
    }

    fn stddevs_mut(&mut self, _key: &str) -> Option<&mut [f64]> {
        None
    }
}
