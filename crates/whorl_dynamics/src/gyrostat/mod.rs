//! Gyrostat about the bearing's centre of rotation.
//!
//! The total angular momentum about the centre of rotation, in body axes, is (eq. 4.9)
//!
//! ```text
//! h = I w + A J Om
//! ```
//!
//! with I the inertia of platform and wheels locked to it, w = omega_wb_b, A the wheels' axes as
//! columns, J their spin inertias, Om their speeds relative to the body. Momentum balance in
//! turning axes, and of each wheel about its axis (eq. 4.14, u the torque on the wheel):
//!
//! ```text
//! I dw/dt + A J dOm/dt + w x h = g
//! J (dOm/dt + A^T dw/dt) = u
//! ```
//!
//! Eliminating dOm/dt gives, as eqs. 4.11-4.13 and 4.81,
//!
//! ```text
//! (I - A J A^T) dw/dt = g - w x h - A u
//! ```
//!
//! [`equation`] implements them, for use with any numbers; [`Gyrostat`] is a
//! platform's model with its effects in them.
//!
//! The gravity torque is -(m g r_cg) x k_b (eq. 4.74). Other bodies that do not follow rigidly
//! (slosh, flexible modes) enter like the wheels: see
//! [`crate::Effect::reaction_inertia_b_kg_m2`]. A wheel that is stuck by Coulomb friction turns
//! with the body: its u is the constraint torque and it drops out of both sums.
//!
//! The dissertation's eq. 4.6 lacks the factor 1/2 in the quaternion kinematics; q here follows
//! dq/dt = 1/2 q (x) [0, w].

mod derivative;
pub mod equation;
mod state;

pub use crate::actuators::{jets::MAX_JETS, wheels::MAX_WHEELS};
pub use derivative::MAX_DISTURBANCES;
pub(crate) use derivative::{Derivative, Drive, Fading};
pub use equation::{LinearisedRate, RateEquation};
pub use state::State;

use std::sync::Arc;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_math::vertical_b;

use crate::actuators::{ActuatorError, Drives};
use crate::effects::{EffectError, EffectSet, ThrustLag, TrueImu};
use crate::sensing::specific_force_b_m_s2;
use crate::{Environment, MeasuredSupplies, PlatformModel};

/// Why a platform cannot be simulated.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GyrostatError {
    /// Its effects were refused.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// Its actuators cannot be simulated.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// Wheels, gimbals or moving masses have more inertia than the platform that contains them.
    #[error(
        "the inertia left when the wheels' spin inertias, the gimbals' and moving masses are taken out is not positive definite"
    )]
    NothingLeft,
}

/// A platform with its effects applied: the one model behind simulation, fits and compensation.
#[derive(Debug, Clone)]
pub struct Gyrostat {
    model: PlatformModel,
    effects: EffectSet,
    thrust_lag: ThrustLag,
    /// Inertia that does not follow the body rigidly.
    reaction_inertia_b_kg_m2: Matrix3<f64>,
    /// With every wheel free.
    equation: RateEquation,
    /// Of a run, in place of the model's.
    supplies: Arc<MeasuredSupplies>,
}

/// Accelerations of body and wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accelerations {
    /// Of the body, body axes [rad/s^2].
    pub omega_dot_wb_b_rad_s2: Vector3<f64>,
    /// Of each wheel relative to the body about its axis [rad/s^2]; zero beyond the platform's own wheels.
    pub wheel_rad_s2: [f64; MAX_WHEELS],
}

impl Gyrostat {
    /// Applies the effects that `model` names.
    ///
    /// # Errors
    /// See [`GyrostatError`].
    pub fn new(model: &PlatformModel) -> Result<Self, GyrostatError> {
        model.actuators.check()?;
        let effects = EffectSet::from_map(&model.effects, model)?;
        let adjusted = effects.adjusted(model)?;
        adjusted.actuators.check()?;
        let reaction_inertia_b_kg_m2 = effects.reaction_inertia_b_kg_m2(&adjusted);
        let thrust_lag = effects.thrust_lag();
        // With fewer free parts the resisting inertia only grows, so all parts free is the case to check.
        let free = adjusted.actuators.idle(thrust_lag, 0);
        rate_equation(&adjusted, &reaction_inertia_b_kg_m2, Some(&free)).ok_or(GyrostatError::NothingLeft)?;
        let equation =
            rate_equation(&adjusted, &reaction_inertia_b_kg_m2, None).ok_or(GyrostatError::NothingLeft)?;
        let supplies = Arc::default();
        Ok(Self { thrust_lag, reaction_inertia_b_kg_m2, equation, model: adjusted, effects, supplies })
    }

    /// The platform, constants corrected by its effects.
    #[must_use]
    pub fn model(&self) -> &PlatformModel {
        &self.model
    }

    pub(crate) fn model_mut(&mut self) -> &mut PlatformModel {
        &mut self.model
    }

    /// What was measured of a run's supplies, if its plant was given any.
    #[must_use]
    pub fn supplies(&self) -> &Arc<MeasuredSupplies> {
        &self.supplies
    }

    pub(crate) fn set_supplies(&mut self, supplies: Arc<MeasuredSupplies>) {
        self.supplies = supplies;
    }

    /// Its effects.
    #[must_use]
    pub fn effects(&self) -> &EffectSet {
        &self.effects
    }

    /// Its equation of motion with every wheel free; what effects take out of the inertia resists no more.
    #[must_use]
    pub fn rate_equation(&self) -> &RateEquation {
        &self.equation
    }

    /// The same with the stuck parts fixed: they turn with the body.
    pub(crate) fn rate_equation_now(&self, drives: &Drives) -> RateEquation {
        // It resists more than with every part free, which was checked.
        rate_equation(&self.model, &self.reaction_inertia_b_kg_m2, Some(drives)).unwrap_or(self.equation)
    }

    /// Total momentum in a state of the plant, body axes [N m s].
    #[must_use]
    #[inline]
    pub(crate) fn total_momentum_b_n_m_s(&self, state: &State) -> Vector3<f64> {
        let mut momentum = self.model.mass_properties.inertia_b_kg_m2() * state.omega_wb_b_rad_s;
        self.model.actuators.add_momentum(&state.actuators, &mut momentum);
        momentum
    }

    /// Lag of the jets' thrust behind their valves.
    #[must_use]
    pub fn thrust_lag(&self) -> ThrustLag {
        self.thrust_lag
    }

    /// Whether valves open and close, and thrust follows them, as on another platform with the same jets and commands.
    #[must_use]
    pub fn has_valves_of(&self, other: &Self) -> bool {
        let delays_s = |of: &Self| {
            of.model().jets().iter().map(|jet| (jet.opening_delay_s, jet.closing_delay_s)).collect::<Vec<_>>()
        };
        // Delays may depend on the bus: as at rest, with a bus that is low by 1 V.
        let at_low_bus_s = |of: &Self| {
            let mut environment =
                Environment::new(of.model(), nalgebra::UnitQuaternion::identity(), Vector3::zeros());
            environment.bus_voltage_v -= 1.0;
            of.effects().valve_delay_s(&environment)
        };
        self.thrust_lag() == other.thrust_lag()
            && delays_s(self) == delays_s(other)
            && at_low_bus_s(self) == at_low_bus_s(other)
    }

    /// Potential energy of the gravity offset \[J\], zero with the centre of mass level with the
    /// centre of rotation; zero throughout where weight has no moment.
    #[must_use]
    pub fn potential_energy_j(&self, q_world_body: &UnitQuaternion<f64>) -> f64 {
        if !self.model.freedom.has_weight() {
            return 0.0;
        }
        self.model.mass_properties.gravity_offset_b_n_m().dot(&vertical_b(q_world_body))
    }

    /// Torque that is there without any command, body axes [N m]: gravity offset and effects. This is
    /// what a controller feeds forward.
    #[must_use]
    pub fn modelled_torque_b_n_m(&self, environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        self.effects.torque_b_n_m(environment, hidden)
            + self.equation.gravity_torque_n_m(
                self.model.mass_properties.gravity_offset_b_n_m(),
                &environment.vertical_b,
            )
    }

    /// Accelerations with every wheel free and the gimbals moving as measured, under what the model has and a torque that it does not have
    /// (`outside_b_n_m`: moving masses, a command in simulation) [N m].
    #[must_use]
    pub fn accelerations(
        &self,
        environment: &Environment<'_>,
        hidden: &[f64],
        outside_b_n_m: &Vector3<f64>,
    ) -> Accelerations {
        let omega = environment.omega_wb_b_rad_s;
        let momentum = self.momentum_b_n_m_s(&omega, environment.wheel_speed_rad_s)
            + self.gyro_momentum_b_n_m_s(environment);
        let mut torque = self.modelled_torque_b_n_m(environment, hidden) + outside_b_n_m;
        if environment.valve_fraction.iter().any(|fraction| *fraction != 0.0) {
            torque += self.jet_torque_b_n_m(environment);
        }
        let (wheel_torque, stuck) = (self.wheel_torque_n_m(environment), [false; MAX_WHEELS]);
        let on_parts = self.on_wheels_b_n_m(&wheel_torque, &stuck) + self.on_gyros_b_n_m(environment);
        let omega_dot = self.equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &on_parts);
        Accelerations {
            omega_dot_wb_b_rad_s2: omega_dot,
            wheel_rad_s2: self.wheel_accelerations_rad_s2(&wheel_torque, &stuck, &omega_dot),
        }
    }

    /// The same for a body that is held still: only the wheels move.
    #[must_use]
    pub fn clamped_accelerations(&self, environment: &Environment<'_>) -> Accelerations {
        let (wheel_torque, still) = (self.wheel_torque_n_m(environment), Vector3::zeros());
        Accelerations {
            omega_dot_wb_b_rad_s2: still,
            wheel_rad_s2: self.wheel_accelerations_rad_s2(&wheel_torque, &[false; MAX_WHEELS], &still),
        }
    }

    /// Angular acceleration with every wheel free, body axes [rad/s^2].
    #[must_use]
    pub fn angular_acceleration_b_rad_s2(
        &self,
        environment: &Environment<'_>,
        hidden: &[f64],
    ) -> Vector3<f64> {
        self.accelerations(environment, hidden, &Vector3::zeros()).omega_dot_wb_b_rad_s2
    }

    /// Inertia that resists angular acceleration with every wheel free, body axes [kg m^2]: I - A J A^T less what does
    /// not follow rigidly.
    #[must_use]
    pub fn resisting_inertia_b_kg_m2(&self) -> Matrix3<f64> {
        *self.equation.resisting_b_kg_m2()
    }

    /// Readings of inertial sensors without errors or a low-pass of their own, effects included, body axes:
    /// `environment` must hold the angular acceleration.
    #[must_use]
    pub fn true_imu(&self, environment: &Environment<'_>) -> TrueImu {
        let mut imu = self.ideal_imu(environment);
        self.effects.measure_imu(environment, &mut imu);
        imu
    }

    /// The same without effects.
    #[must_use]
    pub(crate) fn ideal_imu(&self, environment: &Environment<'_>) -> TrueImu {
        let weight_b =
            if self.model.freedom.has_weight() { environment.vertical_b } else { Vector3::zeros() };
        TrueImu {
            angular_velocity_b_rad_s: environment.omega_wb_b_rad_s,
            specific_force_b_m_s2: specific_force_b_m_s2(
                &self.model.sensors.accelerometer.lever_arm_b_m,
                &environment.omega_wb_b_rad_s,
                &environment.omega_dot_wb_b_rad_s2,
                &weight_b,
            ),
        }
    }
}

fn rate_equation(
    model: &PlatformModel,
    reaction_inertia_b_kg_m2: &Matrix3<f64>,
    drives: Option<&Drives>,
) -> Option<RateEquation> {
    let inertia = *model.mass_properties.inertia_b_kg_m2();
    let mut left = inertia - reaction_inertia_b_kg_m2;
    model.actuators.take_out(drives, &mut left);
    RateEquation::with_freedom(model.freedom, inertia, left)
}
