//! On/off cold-gas jets and their gas.

mod dynamics;
mod gyrostat;
mod plant;
mod platform;
mod tank;
mod valves;

pub use dynamics::State;
pub(crate) use dynamics::{Drive, Forces};
pub use tank::Tank;
pub use valves::{JetFailure, Pulse};

use nalgebra::{Unit, Vector3};

use super::kind::check_count;
use super::{ActuatorError, ActuatorKind, Allowed, Field, Group, KindPrior};

/// Jets the integrator holds.
pub const MAX_JETS: usize = 32;

/// An on/off cold-gas jet.
#[derive(Debug, Clone, PartialEq)]
pub struct Jet {
    /// Name in parameter files.
    pub name: String,
    /// Nozzle position from the centre of rotation, body axes \[m\].
    pub position_b_m: Vector3<f64>,
    /// Direction of the force on the platform (opposite to the plume), body axes.
    pub force_direction_b: Unit<Vector3<f64>>,
    /// Thrust at the tank's reference pressure \[N\], > 0.
    pub thrust_n: f64,
    /// Shortest pulse the valve can make \[s\], >= 0.
    pub min_on_time_s: f64,
    /// From the command to full thrust \[s\], >= 0.
    pub opening_delay_s: f64,
    /// From the end of the command to no thrust \[s\], >= 0.
    pub closing_delay_s: f64,
}

impl Jet {
    /// Torque on the body about the centre of rotation at the reference pressure, body axes [N m].
    #[must_use]
    pub fn torque_b_n_m(&self) -> Vector3<f64> {
        self.position_b_m.cross(&(self.force_direction_b.into_inner() * self.thrust_n))
    }
}

/// The jets of a platform, in the order of every per-jet array in messages, and their gas.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Jets {
    /// The jets.
    pub list: Vec<Jet>,
    /// What they blow.
    pub tank: Tank,
}

impl ActuatorKind for Jets {
    fn groups(&self) -> &'static [Group] {
        &[Group::Members { name: "jets", defaults: "jet_defaults" }, Group::One { name: "tank" }]
    }

    fn add(&mut self, name: String) {
        self.list.push(Jet {
            name,
            position_b_m: Vector3::zeros(),
            force_direction_b: Vector3::z_axis(),
            thrust_n: 0.0,
            min_on_time_s: 0.0,
            opening_delay_s: 0.0,
            closing_delay_s: 0.0,
        });
    }

    fn count(&self) -> usize {
        self.list.len()
    }

    fn names(&self) -> Vec<&str> {
        self.list.iter().map(|jet| jet.name.as_str()).collect()
    }

    fn fields(&mut self, group: usize, member: usize) -> Vec<Field<'_>> {
        use Allowed::{Between, Positive};
        if group == 1 {
            return self.tank.fields();
        }
        let Some(jet) = self.list.get_mut(member) else { return Vec::new() };
        let delay = Between(0.0, 1.0);
        vec![
            Field::vector(
                "position_m",
                "nozzle from the centre of rotation, body axes",
                "m",
                &mut jet.position_b_m,
            ),
            Field::direction(
                "force_direction",
                "force on the platform, opposite to the plume, body axes",
                &mut jet.force_direction_b,
            ),
            Field::number(
                "thrust_n",
                "thrust at the reference pressure",
                "N",
                Positive,
                &mut jet.thrust_n,
            )
            .shared(),
            Field::number("min_on_time_s", "shortest pulse of the valve", "s", delay, &mut jet.min_on_time_s)
                .or(0.0)
                .shared(),
            Field::number(
                "opening_delay_s",
                "from the command to full thrust",
                "s",
                delay,
                &mut jet.opening_delay_s,
            )
            .or(0.0)
            .shared(),
            Field::number(
                "closing_delay_s",
                "from the end of the command to no thrust",
                "s",
                delay,
                &mut jet.closing_delay_s,
            )
            .or(0.0)
            .shared(),
        ]
    }

    fn check(&self) -> Result<(), ActuatorError> {
        check_count("jets", self.list.len(), MAX_JETS)?;
        self.tank.check()
    }
}

/// How well jets are known.
#[derive(Debug, Clone, PartialEq)]
pub struct JetPriors {
    /// Of each jet's thrust, as a share of its value.
    pub thrust: Vec<f64>,
    /// Of each jet's torque direction, about each of two axes across it \[rad\].
    pub direction_rad: Vec<f64>,
    /// Of each valve's delays of opening and closing \[s\]; fits move those of all valves alike.
    pub opening_delay_s: Vec<f64>,
    /// See there.
    pub closing_delay_s: Vec<f64>,
}

impl JetPriors {
    /// Thrust to 5 %, directions to 10 mrad. Delays are taken as they are stated: what is off is found as the effect
    /// `thruster_delay`.
    pub(super) fn typical(jets: &Jets) -> Self {
        let each = |stddev: f64| vec![stddev; jets.list.len()];
        Self {
            thrust: each(0.05),
            direction_rad: each(1.0e-2),
            opening_delay_s: each(0.0),
            closing_delay_s: each(0.0),
        }
    }
}

impl KindPrior for JetPriors {
    fn keys(&self) -> &'static [&'static str] {
        &["thrust_n", "force_direction", "opening_delay_s", "closing_delay_s"]
    }

    fn is_share(&self, key: &str) -> bool {
        key == "thrust_n"
    }

    fn stddevs(&self, key: &str) -> Option<&[f64]> {
        match key {
            "thrust_n" => Some(&self.thrust),
            "force_direction" => Some(&self.direction_rad),
            "opening_delay_s" => Some(&self.opening_delay_s),
            "closing_delay_s" => Some(&self.closing_delay_s),
            _ => None,
        }
    }

    fn stddevs_mut(&mut self, key: &str) -> Option<&mut [f64]> {
        match key {
            "thrust_n" => Some(&mut self.thrust),
            "force_direction" => Some(&mut self.direction_rad),
            "opening_delay_s" => Some(&mut self.opening_delay_s),
            "closing_delay_s" => Some(&mut self.closing_delay_s),
            _ => None,
        }
    }
}
