//! Momentum wheels.

mod dynamics;
mod gyrostat;
mod motors;
mod plant;
mod platform;

pub use dynamics::State;
pub(crate) use dynamics::{Drive, Forces, available_motor_torque_n_m, sign, torque_by_speed_n_m_s};

use nalgebra::{Unit, Vector3};

use super::kind::{check_count, check_positive};
use super::{ActuatorError, ActuatorKind, Allowed, Field, Group, Joints, KindPrior, Motor, MotorChannel};

/// Wheels the integrator holds.
pub const MAX_WHEELS: usize = 8;

/// A momentum wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct Wheel {
    /// Name in parameter files and JointState messages.
    pub name: String,
    /// Spin axis in body axes. Positive wheel speed is right-handed about it, seen from the body.
    pub spin_axis_b: Unit<Vector3<f64>>,
    /// Inertia about the spin axis [kg m^2], > 0.
    pub spin_inertia_kg_m2: f64,
    /// Largest motor torque, either sign [N m], > 0. Torque u on the wheel reacts as -u on the body.
    pub max_torque_n_m: f64,
    /// Largest speed relative to the body, either direction [rad/s], > 0.
    pub max_speed_rad_s: f64,
    /// Viscous drag of the wheel's bearing and motor [N m s], >= 0.
    pub viscous_friction_n_m_s: f64,
    /// Coulomb drag [N m], >= 0.
    pub coulomb_friction_n_m: f64,
}

/// The wheels of a platform, in the order of every per-wheel array in messages.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Wheels(pub Vec<Wheel>);

impl ActuatorKind for Wheels {
    fn groups(&self) -> &'static [Group] {
        &[Group::Members { name: "wheels", defaults: "wheel_defaults" }]
    }

    fn add(&mut self, name: String) {
        self.0.push(Wheel {
            name,
            spin_axis_b: Vector3::z_axis(),
            spin_inertia_kg_m2: 0.0,
            max_torque_n_m: 0.0,
            max_speed_rad_s: 0.0,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        });
    }

    fn count(&self) -> usize {
        self.0.len()
    }

    fn names(&self) -> Vec<&str> {
        self.0.iter().map(|wheel| wheel.name.as_str()).collect()
    }

    fn fields(&mut self, _group: usize, member: usize) -> Vec<Field<'_>> {
        use Allowed::{NonNegative, Positive};
        let Some(wheel) = self.0.get_mut(member) else { return Vec::new() };
        vec![
            Field::direction(
                "spin_axis",
                "spin axis, body axes; positive speed is right-handed about it",
                &mut wheel.spin_axis_b,
            ),
            Field::number(
                "spin_inertia_kg_m2",
                "inertia about the spin axis",
                "kg m^2",
                Positive,
                &mut wheel.spin_inertia_kg_m2,
            )
            .shared(),
            Field::number(
                "max_torque_n_m",
                "largest motor torque, either sign",
                "N m",
                Positive,
                &mut wheel.max_torque_n_m,
            )
            .shared(),
            Field::number(
                "max_speed_rad_s",
                "largest speed relative to the body",
                "rad/s",
                Positive,
                &mut wheel.max_speed_rad_s,
            )
            .shared(),
            Field::number(
                "viscous_friction_n_m_s",
                "viscous drag of bearing and motor",
                "N m s",
                NonNegative,
                &mut wheel.viscous_friction_n_m_s,
            )
            .or(0.0)
            .shared(),
            Field::number(
                "coulomb_friction_n_m",
                "Coulomb drag",
                "N m",
                NonNegative,
                &mut wheel.coulomb_friction_n_m,
            )
            .or(0.0)
            .shared(),
        ]
    }

    fn check(&self) -> Result<(), ActuatorError> {
        check_count("wheels", self.0.len(), MAX_WHEELS)?;
        check_positive(self.0.iter().flat_map(|wheel| {
            [
                (wheel.spin_inertia_kg_m2, "a wheel's spin inertia"),
                (wheel.max_torque_n_m, "a wheel's largest torque"),
                (wheel.max_speed_rad_s, "a wheel's largest speed"),
            ]
        }))
    }

    fn channel(&self) -> Option<MotorChannel> {
        Some(MotorChannel {
            command_field: "wheel_torque_n_m",
            state_topic: "wheels/state",
            needs_position: false,
        })
    }

    fn motors(&self, joints: &Joints, effects: &[f64], motors: &mut [Motor]) {
        self.motors_now(joints, effects, motors);
    }

    fn momentum_b_n_m_s(&self, joints: &Joints) -> Vector3<f64> {
        self.stored_b_n_m_s(joints)
    }

    fn momentum_rate_b_n_m(&self, _joints: &Joints, effort_n_m: &[f64]) -> Vector3<f64> {
        let torques = self.0.iter().zip(effort_n_m);
        torques.fold(Vector3::zeros(), |sum, (wheel, u)| sum + wheel.spin_axis_b.into_inner() * *u)
    }

    fn momentum_noise_n_m_s(&self, speed_noise_rad_s: f64) -> f64 {
        self.0.iter().map(|wheel| wheel.spin_inertia_kg_m2).fold(0.0, f64::max) * speed_noise_rad_s
    }
}

/// How well wheels are known.
#[derive(Debug, Clone, PartialEq)]
pub struct WheelPriors {
    /// Of each wheel's spin inertia, as a share of its value.
    pub spin_inertia: Vec<f64>,
    /// Of each wheel's spin axis, about each of two axes across it \[rad\].
    pub axis_rad: Vec<f64>,
    /// Of each wheel's viscous friction [N m s].
    pub viscous_friction_n_m_s: Vec<f64>,
    /// Of each wheel's Coulomb friction [N m].
    pub coulomb_friction_n_m: Vec<f64>,
}

impl WheelPriors {
    /// Spin inertia to 1 %, axes to 2 mrad. Friction is taken as it is stated: no number is typical of all bearings, and one that is off
    /// is found as the effect `wheel_friction`.
    pub(super) fn typical(wheels: &Wheels) -> Self {
        let each = |stddev: f64| vec![stddev; wheels.0.len()];
        Self {
            spin_inertia: each(0.01),
            axis_rad: each(2.0e-3),
            viscous_friction_n_m_s: each(0.0),
            coulomb_friction_n_m: each(0.0),
        }
    }
}

impl KindPrior for WheelPriors {
    fn keys(&self) -> &'static [&'static str] {
        &["spin_inertia_kg_m2", "spin_axis", "viscous_friction_n_m_s", "coulomb_friction_n_m"]
    }

    fn is_share(&self, key: &str) -> bool {
        key == "spin_inertia_kg_m2"
    }

    fn stddevs(&self, key: &str) -> Option<&[f64]> {
        match key {
            "spin_inertia_kg_m2" => Some(&self.spin_inertia),
            "spin_axis" => Some(&self.axis_rad),
            "viscous_friction_n_m_s" => Some(&self.viscous_friction_n_m_s),
            "coulomb_friction_n_m" => Some(&self.coulomb_friction_n_m),
            _ => None,
        }
    }

    fn stddevs_mut(&mut self, key: &str) -> Option<&mut [f64]> {
        match key {
            "spin_inertia_kg_m2" => Some(&mut self.spin_inertia),
            "spin_axis" => Some(&mut self.axis_rad),
            "viscous_friction_n_m_s" => Some(&mut self.viscous_friction_n_m_s),
            "coulomb_friction_n_m" => Some(&mut self.coulomb_friction_n_m),
            _ => None,
        }
    }
}
