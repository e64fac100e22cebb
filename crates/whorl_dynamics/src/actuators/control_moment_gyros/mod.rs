//! Single-gimbal control moment gyros with rotors of constant speed.
//!
//! Rotor momentum h0 along s(gamma), gimbal axis g fixed in the body, t = g x s. Relative to the body a gyro has the
//! momentum (e.g. Wie, *Space Vehicle Dynamics and Control*, AIAA 1998, section 7.5)
//!
//! ```text
//! h = h0 s + J_g dgamma/dt g
//! ```
//!
//! and its gimbal follows, from Lagrange's equation with the rotor's speed held,
//!
//! ```text
//! J_g (d2gamma/dt2 + g . dw/dt) = u + h0 t . w - b dgamma/dt - T sign(dgamma/dt)
//! ```
//!
//! with viscous friction b and Coulomb friction T of its bearing, which holds a gimbal at rest that less than T drives.
//! Its drive is a proportional rate control, u = J_g (asked - dgamma/dt) / tau, which slows down before the gimbal's
//! travel ends: the rate asked never exceeds what is left of it over 4 tau.
//!
//! The inertia of the gimbal assembly is taken as the same at every angle, and is part of the platform's.
//!
//! What a model makes of *measured* gimbals is in `gyrostat`; how near they are to a singular configuration, and where
//! null motion leads them, in [`singularity`].

mod dynamics;
mod gyrostat;
mod plant;
mod platform;
pub mod singularity;
#[cfg(test)]
mod tests;

pub use dynamics::State;
pub(crate) use dynamics::{Drive, Forces};

use nalgebra::{Unit, Vector3};

use super::kind::{check_count, check_positive};
use super::{ActuatorError, ActuatorKind, Allowed, Field, Group, Joints, KindPrior, Motor, MotorChannel};

/// Gyros the integrator holds.
pub const MAX_GYROS: usize = 6;

/// A control moment gyro.
#[derive(Debug, Clone, PartialEq)]
pub struct Gyro {
    /// Name in parameter files and JointState messages.
    pub name: String,
    /// Gimbal axis, body axes; positive gimbal angles are right-handed about it.
    pub gimbal_axis_b: Unit<Vector3<f64>>,
    /// Spin axis of the rotor at gimbal angle zero, body axes; its component along the gimbal axis does not count.
    pub spin_axis_b: Unit<Vector3<f64>>,
    /// Momentum of the rotor [N m s], > 0.
    pub rotor_momentum_n_m_s: f64,
    /// Inertia of gimbal and rotor about the gimbal axis [kg m^2], > 0.
    pub gimbal_inertia_kg_m2: f64,
    /// Largest gimbal rate, either sign [rad/s], > 0.
    pub max_rate_rad_s: f64,
    /// Largest gimbal angle, either sign \[rad\], > 0.
    pub max_angle_rad: f64,
    /// Time constant of the gimbal's rate control \[s\], > 0.
    pub time_constant_s: f64,
    /// Viscous friction of the gimbal's bearing [N m s], >= 0.
    pub viscous_friction_n_m_s: f64,
    /// Coulomb friction of the gimbal's bearing [N m], >= 0.
    pub coulomb_friction_n_m: f64,
}

/// Time in which a gimbal that nears the end of its travel would cover the rest at its present rate, at least, in time
/// constants of its rate control: the fastest approach without overshoot of a loop with that lag.
const APPROACH: f64 = 4.0;
/// Rate below which Coulomb friction is compensated in proportion [rad/s]: its sign is noise there.
const COULOMB_RATE_RAD_S: f64 = 2e-3;

impl Gyro {
    /// s and t at a gimbal angle, body axes.
    pub(crate) fn axes_b(&self, angle_rad: f64) -> (Vector3<f64>, Vector3<f64>) {
        let across = self.gimbal_axis_b.cross(&self.spin_axis_b);
        let t0 = across.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let s0 = t0.cross(&self.gimbal_axis_b);
        let (sin, cos) = angle_rad.sin_cos();
        (s0 * cos + t0 * sin, t0 * cos - s0 * sin)
    }

    /// Torque with which the body turns the rotor per unit of gimbal rate, h0 t, body axes [N m s]; also that about the
    /// gimbal axis per unit of body rate along it.
    #[must_use]
    pub fn torque_per_rate_b_n_m_s(&self, angle_rad: f64) -> Vector3<f64> {
        self.axes_b(angle_rad).1 * self.rotor_momentum_n_m_s
    }

    /// The rates that its drive accepts at a gimbal angle [rad/s].
    fn rates_rad_s(&self, angle_rad: f64) -> (f64, f64) {
        let over_s = APPROACH * self.time_constant_s;
        let limit = self.max_rate_rad_s;
        let within = |rate: f64| rate.max(-limit).min(limit);
        (within((-self.max_angle_rad - angle_rad) / over_s), within((self.max_angle_rad - angle_rad) / over_s))
    }

    /// Torque of its motor that is asked for this rate [N m].
    fn motor_torque_n_m(&self, asked_rad_s: f64, angle_rad: f64, rate_rad_s: f64) -> f64 {
        let (least, most) = self.rates_rad_s(angle_rad);
        self.gimbal_inertia_kg_m2 * (asked_rad_s.max(least).min(most) - rate_rad_s) / self.time_constant_s
    }
}

/// The control moment gyros of a platform.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ControlMomentGyros(pub Vec<Gyro>);

impl ActuatorKind for ControlMomentGyros {
    fn groups(&self) -> &'static [Group] {
        &[Group::Members { name: "control_moment_gyros", defaults: "control_moment_gyro_defaults" }]
    }

    fn add(&mut self, name: String) {
        self.0.push(Gyro {
            name,
            gimbal_axis_b: Vector3::z_axis(),
            spin_axis_b: Vector3::x_axis(),
            rotor_momentum_n_m_s: 0.0,
            gimbal_inertia_kg_m2: 0.0,
            max_rate_rad_s: 0.0,
            max_angle_rad: 0.0,
            time_constant_s: 0.0,
            viscous_friction_n_m_s: 0.0,
            coulomb_friction_n_m: 0.0,
        });
    }

    fn count(&self) -> usize {
        self.0.len()
    }

    fn names(&self) -> Vec<&str> {
        self.0.iter().map(|gyro| gyro.name.as_str()).collect()
    }

    fn fields(&mut self, _group: usize, member: usize) -> Vec<Field<'_>> {
        use Allowed::{NonNegative, Positive};
        let Some(gyro) = self.0.get_mut(member) else { return Vec::new() };
        vec![
            Field::direction("gimbal_axis", "gimbal axis, body axes", &mut gyro.gimbal_axis_b),
            Field::direction(
                "spin_axis",
                "spin axis of the rotor at gimbal angle zero, body axes",
                &mut gyro.spin_axis_b,
            ),
            Field::number(
                "rotor_momentum_n_m_s",
                "momentum of the rotor",
                "N m s",
                Positive,
                &mut gyro.rotor_momentum_n_m_s,
            )
            .shared(),
            Field::number(
                "gimbal_inertia_kg_m2",
                "inertia of gimbal and rotor about the gimbal axis",
                "kg m^2",
                Positive,
                &mut gyro.gimbal_inertia_kg_m2,
            )
            .shared(),
            Field::number(
                "max_rate_rad_s",
                "largest gimbal rate, either sign",
                "rad/s",
                Positive,
                &mut gyro.max_rate_rad_s,
            )
            .shared(),
            Field::number(
                "max_angle_rad",
                "largest gimbal angle, either sign",
                "rad",
                Positive,
                &mut gyro.max_angle_rad,
            )
            .shared(),
            Field::number(
                "time_constant_s",
                "time constant of the gimbal's rate control",
                "s",
                Positive,
                &mut gyro.time_constant_s,
            )
            .shared(),
            Field::number(
                "viscous_friction_n_m_s",
                "viscous friction of the gimbal's bearing",
                "N m s",
                NonNegative,
                &mut gyro.viscous_friction_n_m_s,
            )
            .or(0.0)
            .shared(),
            Field::number(
                "coulomb_friction_n_m",
                "Coulomb friction of the gimbal's bearing",
                "N m",
                NonNegative,
                &mut gyro.coulomb_friction_n_m,
            )
            .or(0.0)
            .shared(),
        ]
    }

    fn check(&self) -> Result<(), ActuatorError> {
        check_count("control moment gyros", self.0.len(), MAX_GYROS)?;
        check_positive(self.0.iter().flat_map(|gyro| {
            [
                (gyro.gimbal_inertia_kg_m2, "a gimbal's inertia"),
                (gyro.max_rate_rad_s, "a gimbal's largest rate"),
                (gyro.time_constant_s, "a gimbal's time constant"),
                (gyro.axes_b(0.0).0.norm(), "the angle between a gyro's axes"),
            ]
        }))
    }

    fn channel(&self) -> Option<MotorChannel> {
        Some(MotorChannel {
            command_field: "gimbal_rate_rad_s",
            state_topic: "gimbals/state",
            needs_position: true,
        })
    }

    /// Commands are gimbal rates [rad/s]. The rate control gives way to friction by the rate that its torque is worth,
    /// which is commanded on top.
    fn motors(&self, joints: &Joints, _effects: &[f64], motors: &mut [Motor]) {
        for (j, (gyro, motor)) in self.0.iter().zip(motors).enumerate() {
            let (limit, angle, rate) = (gyro.max_rate_rad_s, joints.position(j), joints.velocity(j));
            let coulomb = gyro.coulomb_friction_n_m * (rate / COULOMB_RATE_RAD_S).clamp(-1.0, 1.0);
            let friction = gyro.viscous_friction_n_m_s * rate + coulomb;
            let feedforward = friction * gyro.time_constant_s / gyro.gimbal_inertia_kg_m2;
            let feedforward = feedforward.max(-limit).min(limit);
            let (least, most) = gyro.rates_rad_s(angle);
            let most = most.min(limit - feedforward);
            *motor = Motor {
                torque_b: gyro.axes_b(angle).1 * -gyro.rotor_momentum_n_m_s,
                limit,
                min: least.max(-limit - feedforward).min(most),
                max: most,
                feedforward,
            };
        }
    }

    /// Null motion: along the slope of the singularity measure, so that gimbals that are free to do so move away from
    /// where they could not turn the body about every axis.
    fn prefer(&self, joints: &Joints, preferred: &mut [f64]) {
        singularity::null_motion_rad_s(&self.0, &joints.position_rad, preferred);
    }

    fn may_be_singular(&self) -> bool {
        true
    }

    fn momentum_b_n_m_s(&self, joints: &Joints) -> Vector3<f64> {
        self.0.iter().enumerate().fold(Vector3::zeros(), |sum, (j, gyro)| {
            sum + gyro.axes_b(joints.position(j)).0 * gyro.rotor_momentum_n_m_s
                + gyro.gimbal_axis_b.into_inner() * (gyro.gimbal_inertia_kg_m2 * joints.velocity(j))
        })
    }

    /// h0 dgamma/dt t: the gimbals' rate turns the rotors, whatever torque that takes.
    fn momentum_rate_b_n_m(&self, joints: &Joints, _effort: &[f64]) -> Vector3<f64> {
        self.0.iter().enumerate().fold(Vector3::zeros(), |sum, (j, gyro)| {
            let across = gyro.axes_b(joints.position(j)).1;
            sum + across * (gyro.rotor_momentum_n_m_s * joints.velocity(j))
        })
    }

    fn momentum_noise_n_m_s(&self, speed_noise_rad_s: f64) -> f64 {
        self.0.iter().map(|gyro| gyro.gimbal_inertia_kg_m2).fold(0.0, f64::max) * speed_noise_rad_s
    }
}

/// How well gyros are known.
#[derive(Debug, Clone, PartialEq)]
pub struct GyroPriors {
    /// Of each rotor's momentum, as a share of its value.
    pub rotor_momentum: Vec<f64>,
    /// Of each gimbal axis, about each of two axes across it \[rad\].
    pub axis_rad: Vec<f64>,
}

impl GyroPriors {
    /// Rotor momentum to 1 %, axes to 2 mrad.
    pub(super) fn typical(gyros: &ControlMomentGyros) -> Self {
        Self { rotor_momentum: vec![0.01; gyros.0.len()], axis_rad: vec![2.0e-3; gyros.0.len()] }
    }
}

impl KindPrior for GyroPriors {
    fn keys(&self) -> &'static [&'static str] {
        &["rotor_momentum_n_m_s", "gimbal_axis"]
    }

    fn stddevs(&self, key: &str) -> Option<&[f64]> {
        match key {
            "rotor_momentum_n_m_s" => Some(&self.rotor_momentum),
            "gimbal_axis" => Some(&self.axis_rad),
            _ => None,
        }
    }

    fn stddevs_mut(&mut self, key: &str) -> Option<&mut [f64]> {
        match key {
            "rotor_momentum_n_m_s" => Some(&mut self.rotor_momentum),
            "gimbal_axis" => Some(&mut self.axis_rad),
            _ => None,
        }
    }
}
