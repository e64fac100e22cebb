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
//! [`equation`] is these equations as code, for whoever needs them with numbers of their own; [`Gyrostat`] is a
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
pub(crate) use derivative::{Derivative, Drive, JetDrive};
pub use equation::{LinearisedRate, RateEquation};
pub use state::State;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use thiserror::Error;
use whorl_math::{GRAVITY_M_S2, vertical_b};

use crate::actuators::ActuatorError;
use crate::effects::{EffectError, EffectSet, ThrustLag, TrueImu};
use crate::platform::Wheel;
use crate::sensing::specific_force_b_m_s2;
use crate::{Environment, PlatformModel};
use equation::{gravity_torque_n_m, without_wheels};

/// Why a platform cannot be simulated.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum GyrostatError {
    /// Its effects were refused.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// Its actuators cannot be simulated.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// Wheels or moving masses have more inertia than the platform that contains them.
    #[error(
        "the inertia left when the wheels' spin inertias and moving masses are taken out is not positive definite"
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
        // With fewer free wheels the resisting inertia only grows, so all wheels free is the case to check.
        let equation = rate_equation(&adjusted, &reaction_inertia_b_kg_m2, &[false; MAX_WHEELS])
            .ok_or(GyrostatError::NothingLeft)?;
        Ok(Self {
            thrust_lag: effects.thrust_lag(),
            reaction_inertia_b_kg_m2,
            equation,
            model: adjusted,
            effects,
        })
    }

    /// The platform, constants corrected by its effects.
    #[must_use]
    pub fn model(&self) -> &PlatformModel {
        &self.model
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

    /// The same with these wheels stuck: they turn with the body.
    pub(crate) fn rate_equation_with_stuck(&self, stuck: &[bool; MAX_WHEELS]) -> RateEquation {
        // It resists more than with all wheels free, which was checked.
        rate_equation(&self.model, &self.reaction_inertia_b_kg_m2, stuck).unwrap_or(self.equation)
    }

    /// Lag of the jets' thrust behind their valves.
    #[must_use]
    pub fn thrust_lag(&self) -> ThrustLag {
        self.thrust_lag
    }

    /// Total angular momentum about the centre of rotation, body axes [N m s] (eq. 4.9). Wheels
    /// without an entry in `wheel_speed_rad_s` count as stopped.
    #[must_use]
    pub fn momentum_b_n_m_s(
        &self,
        omega_wb_b_rad_s: &Vector3<f64>,
        wheel_speed_rad_s: &[f64],
    ) -> Vector3<f64> {
        let mut momentum = self.model.mass_properties.inertia_b_kg_m2() * omega_wb_b_rad_s;
        for (wheel, speed) in self.model.wheels().iter().zip(wheel_speed_rad_s) {
            momentum += wheel.spin_axis_b.into_inner() * (wheel.spin_inertia_kg_m2 * speed);
        }
        momentum
    }

    /// Kinetic energy of platform and wheels \[J\].
    #[must_use]
    pub fn kinetic_energy_j(&self, omega_wb_b_rad_s: &Vector3<f64>, wheel_speed_rad_s: &[f64]) -> f64 {
        let inertia = self.model.mass_properties.inertia_b_kg_m2();
        let mut twice = omega_wb_b_rad_s.dot(&(inertia * omega_wb_b_rad_s));
        for (wheel, speed) in self.model.wheels().iter().zip(wheel_speed_rad_s) {
            // J (a.w + Om)^2 - J (a.w)^2: the locked wheel is in I already.
            twice +=
                wheel.spin_inertia_kg_m2 * speed * (2.0 * wheel.spin_axis_b.dot(omega_wb_b_rad_s) + speed);
        }
        0.5 * twice
    }

    /// Potential energy of the gravity offset \[J\], zero with the centre of mass level with the
    /// centre of rotation.
    #[must_use]
    pub fn potential_energy_j(&self, q_world_body: &UnitQuaternion<f64>) -> f64 {
        self.model.mass_properties.gravity_offset_b_n_m().dot(&vertical_b(q_world_body))
    }

    /// Torque that is there without any command, body axes [N m]: gravity offset and effects. This is
    /// what a controller feeds forward.
    #[must_use]
    pub fn modelled_torque_b_n_m(&self, environment: &Environment<'_>, hidden: &[f64]) -> Vector3<f64> {
        self.effects.torque_b_n_m(environment, hidden)
            + gravity_torque_n_m(self.model.mass_properties.gravity_offset_b_n_m(), &environment.vertical_b)
    }

    /// Torque of the jets that are open now, at the present tank pressure, body axes [N m].
    #[must_use]
    pub fn jet_torque_b_n_m(&self, environment: &Environment<'_>) -> Vector3<f64> {
        let mut torque = Vector3::zeros();
        for (jet, fraction) in self.model.jets().iter().zip(environment.valve_fraction) {
            if *fraction != 0.0 {
                torque += jet.torque_b_n_m() * *fraction;
            }
        }
        torque * self.thrust_factor(environment.pressure_ratio())
    }

    /// Torque on each wheel about its axis \[N m\]: motor, friction and effects; the body takes the
    /// opposite. A wheel at zero speed is given no Coulomb friction here.
    #[must_use]
    pub fn wheel_torque_n_m(&self, environment: &Environment<'_>) -> [f64; MAX_WHEELS] {
        let mut torque_n_m = [0.0; MAX_WHEELS];
        for (j, (torque, wheel)) in torque_n_m.iter_mut().zip(self.model.wheels()).enumerate() {
            let speed = environment.wheel_speed(j);
            *torque = environment.wheel_motor_torque(j) + friction_n_m(wheel, speed, sign(speed));
        }
        if let Some(torque_n_m) = torque_n_m.get_mut(..self.model.wheels().len()) {
            self.effects.add_wheel_torque_n_m(environment, torque_n_m);
        }
        torque_n_m
    }

    /// Accelerations with every wheel free, under what the model has and a torque that it does not have
    /// (`outside_b_n_m`: moving masses, a command in simulation) [N m].
    #[must_use]
    pub fn accelerations(
        &self,
        environment: &Environment<'_>,
        hidden: &[f64],
        outside_b_n_m: &Vector3<f64>,
    ) -> Accelerations {
        let omega = environment.omega_wb_b_rad_s;
        let momentum = self.momentum_b_n_m_s(&omega, environment.wheel_speed_rad_s);
        let mut torque = self.modelled_torque_b_n_m(environment, hidden) + outside_b_n_m;
        if environment.valve_fraction.iter().any(|fraction| *fraction != 0.0) {
            torque += self.jet_torque_b_n_m(environment);
        }
        let (wheel_torque, stuck) = (self.wheel_torque_n_m(environment), [false; MAX_WHEELS]);
        let on_wheels = self.on_wheels_b_n_m(&wheel_torque, &stuck);
        let omega_dot = self.equation.acceleration_b_rad_s2(&omega, &momentum, &torque, &on_wheels);
        Accelerations {
            omega_dot_wb_b_rad_s2: omega_dot,
            wheel_rad_s2: self.wheel_accelerations_rad_s2(&wheel_torque, &stuck, &omega_dot),
        }
    }

    /// The same of a body that is held still: only the wheels move.
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

    /// A u over the wheels that are not stuck, body axes [N m].
    #[must_use]
    pub fn on_wheels_b_n_m(
        &self,
        wheel_torque_n_m: &[f64; MAX_WHEELS],
        stuck: &[bool; MAX_WHEELS],
    ) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for ((wheel, torque), stuck) in self.model.wheels().iter().zip(wheel_torque_n_m).zip(stuck) {
            if !stuck {
                sum += wheel.spin_axis_b.into_inner() * *torque;
            }
        }
        sum
    }

    /// dOm/dt = u / J - A^T dw/dt of the wheels that are not stuck [rad/s^2].
    #[must_use]
    pub fn wheel_accelerations_rad_s2(
        &self,
        wheel_torque_n_m: &[f64; MAX_WHEELS],
        stuck: &[bool; MAX_WHEELS],
        omega_dot_wb_b_rad_s2: &Vector3<f64>,
    ) -> [f64; MAX_WHEELS] {
        let mut acceleration = [0.0; MAX_WHEELS];
        let wheels = self.model.wheels().iter().zip(wheel_torque_n_m).zip(stuck);
        for (slot, ((wheel, torque), stuck)) in acceleration.iter_mut().zip(wheels) {
            if !stuck {
                *slot = torque / wheel.spin_inertia_kg_m2 - wheel.spin_axis_b.dot(omega_dot_wb_b_rad_s2);
            }
        }
        acceleration
    }

    /// Inertia that resists angular acceleration with every wheel free, body axes [kg m^2]: I - A J A^T less what does
    /// not follow rigidly.
    #[must_use]
    pub fn resisting_inertia_b_kg_m2(&self) -> Matrix3<f64> {
        *self.equation.resisting_b_kg_m2()
    }

    /// What ideal inertial sensors read, body axes: `environment` must hold the angular acceleration.
    #[must_use]
    pub fn true_imu(&self, environment: &Environment<'_>) -> TrueImu {
        let mut imu = TrueImu {
            angular_velocity_b_rad_s: environment.omega_wb_b_rad_s,
            specific_force_b_m_s2: specific_force_b_m_s2(
                &self.model.sensors.accelerometer.lever_arm_b_m,
                &environment.omega_wb_b_rad_s,
                &environment.omega_dot_wb_b_rad_s2,
                &environment.vertical_b,
            ),
        };
        self.effects.measure_imu(environment, &mut imu);
        imu
    }

    /// Thrust over nominal thrust at this pressure over reference pressure.
    #[must_use]
    pub fn thrust_factor(&self, pressure_ratio: f64) -> f64 {
        let exponent = self.model.tank().thrust_pressure_exponent;
        if pressure_ratio <= 0.0 {
            0.0
        } else if exponent == 0.0 {
            1.0
        } else if exponent == 1.0 {
            pressure_ratio
        } else {
            pressure_ratio.powf(exponent)
        }
    }

    /// Gas in the full tank \[kg\].
    #[must_use]
    pub fn initial_gas_kg(&self) -> f64 {
        let tank = self.model.tank();
        tank.initial_pressure_pa * tank.volume_m3 / (tank.gas_constant_j_kg_k * tank.temperature_k)
    }

    /// Pressure of this much gas in the tank \[Pa\], isothermal.
    #[must_use]
    pub fn pressure_pa(&self, gas_kg: f64) -> f64 {
        let tank = self.model.tank();
        gas_kg * tank.gas_constant_j_kg_k * tank.temperature_k / tank.volume_m3
    }

    /// Gas used per second by this much thrust [kg/s].
    #[must_use]
    pub fn gas_rate_kg_s(&self, thrust_n: f64) -> f64 {
        thrust_n / (GRAVITY_M_S2 * self.model.tank().specific_impulse_s)
    }
}

fn rate_equation(
    model: &PlatformModel,
    reaction_inertia_b_kg_m2: &Matrix3<f64>,
    stuck: &[bool; MAX_WHEELS],
) -> Option<RateEquation> {
    let inertia = *model.mass_properties.inertia_b_kg_m2();
    let free = model.wheels().iter().zip(stuck).filter(|(_, stuck)| !**stuck).map(|(wheel, _)| wheel);
    RateEquation::new(inertia, without_wheels(inertia - reaction_inertia_b_kg_m2, free))
}

/// Friction torque on a wheel [N m] for the given sense of sliding (-1, 0, 1).
fn friction_n_m(wheel: &Wheel, speed_rad_s: f64, sense: f64) -> f64 {
    -wheel.viscous_friction_n_m_s * speed_rad_s - wheel.coulomb_friction_n_m * sense
}

/// -1, 0 or 1.
pub(crate) fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}
