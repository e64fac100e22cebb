//! The kinds of actuator: one kind, one folder.
//!
//! A kind's folder has everything about it:
//!
//! | what | where | used by |
//! |---|---|---|
//! | what its actuators are made of, their entries in parameter files, what must be checked | [`ActuatorKind`] | `whorl_params`, [`crate::Gyrostat`] |
//! | how well these are known before any fit | [`KindPrior`] | `model_prior` of parameter files, adopted changes |
//! | states, commands, forces, reaction, events, readings | `KindDynamics` | gyrostat and plant |
//! | what its motors can do now, columns of the allocation, stored momentum | [`ActuatorKind::motors`], [`ActuatorKind::momentum_b_n_m_s`] | local control, the driver's gate |
//! | field of the command and topic of the joint states | [`MotorChannel`] | local control, driver |
//!
//! To add a kind: write a folder beside the others and name it in `register!` below. A kind with motors needs a
//! field in `ActuatorCommand.msg`, named in `whorl_msgs`' `motor_commands`, and a topic; a test of local control says
//! which is missing. `control_moment_gyros` is the example.

mod dynamics;
mod field;
mod kind;
mod motors;
#[cfg(test)]
mod tests;

pub(crate) use dynamics::{Instant, OnBody};
pub use field::{Allowed, Field, Slot};
pub use kind::{ActuatorError, ActuatorKind, Group, KindPrior, MotorChannel};
pub use motors::{Joints, Motor};

use std::ops::Range;

use dynamics::KindDynamics;
use nalgebra::{Matrix3, Vector3};

use crate::effects::EffectSet;
use crate::gyrostat::{Drive, State};
use crate::platform::SensorSuite;
use crate::sensing::JointSample;
use crate::{Environment, Gyrostat};

macro_rules! register {
    ($($(#[$row:meta])* $module:ident: $kind:ident, $prior:ident;)*) => {
        $($(#[$row])* pub mod $module;)*

        /// The actuators of a platform by kind.
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct Actuators {
            $(
                $(#[$row])*
                #[doc = concat!("See [`", stringify!($module), "`].")]
                pub $module: $module::$kind,
            )*
        }

        /// How well the actuators of a platform are known, by kind.
        #[derive(Debug, Clone, PartialEq)]
        pub struct ActuatorPriors {
            $(
                $(#[$row])*
                #[doc = concat!("See [`", stringify!($module), "`].")]
                pub $module: $module::$prior,
            )*
        }

        /// Continuous states of the actuators by kind, or their rates.
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        pub struct States {
            $(
                $(#[$row])*
                #[doc = concat!("See [`", stringify!($module), "`].")]
                pub $module: $module::State,
            )*
        }

        /// What holds between two events, by kind.
        #[derive(Debug, Clone)]
        pub(crate) struct Drives {
            $($(#[$row])* pub $module: $module::Drive,)*
        }

        /// Torques and flows within each kind at one instant.
        pub(crate) struct Forces {
            $($(#[$row])* $module: $module::Forces,)*
        }

        /// What [`KindDynamics`] says of each kind, of all of them in the order of the table.
        impl Actuators {
            pub(crate) fn at_rest(&self) -> States {
                States { $($(#[$row])* $module: self.$module.at_rest()),* }
            }

            pub(crate) fn idle(&self, gyrostat: &Gyrostat, now_ns: i64) -> Drives {
                Drives { $($(#[$row])* $module: self.$module.idle(gyrostat, now_ns)),* }
            }

            #[inline]
            pub(crate) fn add_scaled(&self, states: &mut States, rates: &States, factor: f64) {
                $($(#[$row])* { self.$module.add_scaled(&mut states.$module, &rates.$module, factor); })*
            }

            #[inline]
            pub(crate) fn bound(&self, states: &mut States) {
                $($(#[$row])* { self.$module.bound(&mut states.$module); })*
            }

            #[inline]
            pub(crate) fn is_finite(&self, states: &States) -> bool {
                let mut finite = true;
                $($(#[$row])* { finite &= self.$module.is_finite(&states.$module); })*
                finite
            }

            #[inline]
            pub(crate) fn show<'a>(
                &'a self,
                states: &'a States,
                drives: &'a Drives,
                environment: &mut Environment<'a>,
            ) -> f64 {
                let mut load = 0.0;
                $($(#[$row])* { load += self.$module.show(&states.$module, &drives.$module, environment); })*
                load
            }

            #[inline]
            pub(crate) fn add_momentum(&self, states: &States, sum_b_n_m_s: &mut Vector3<f64>) {
                $($(#[$row])* { self.$module.add_momentum(&states.$module, sum_b_n_m_s); })*
            }

            pub(crate) fn take_out(&self, drives: Option<&Drives>, left: &mut Matrix3<f64>) {
                $($(#[$row])* { self.$module.take_out(drives.map(|drives| &drives.$module), left); })*
            }

            #[inline]
            pub(crate) fn act(
                &self,
                at: &Instant,
                states: &States,
                drives: &Drives,
                omega_wb_b_rad_s: &Vector3<f64>,
                body: &mut OnBody,
            ) -> Forces {
                Forces {
                    $($(#[$row])* $module: self.$module.act(at, &states.$module, &drives.$module, omega_wb_b_rad_s, body),)*
                }
            }

            #[inline]
            pub(crate) fn add_effects(
                &self,
                effects: &EffectSet,
                environment: &Environment<'_>,
                states: &States,
                forces: &mut Forces,
            ) {
                $($(#[$row])* { self.$module.add_effects(effects, environment, &states.$module, &mut forces.$module); })*
            }

            #[inline]
            pub(crate) fn reaction_b_n_m(&self, drives: &Drives, forces: &Forces) -> Vector3<f64> {
                let mut sum = Vector3::zeros();
                $($(#[$row])* { self.$module.add_reaction(&drives.$module, &forces.$module, &mut sum); })*
                sum
            }

            #[inline]
            pub(crate) fn rates(
                &self,
                states: &States,
                drives: &Drives,
                forces: &Forces,
                omega_dot_wb_b_rad_s2: &Vector3<f64>,
            ) -> States {
                States {
                    $($(#[$row])* $module: self.$module.rate(
                        &states.$module,
                        &drives.$module,
                        &forces.$module,
                        omega_dot_wb_b_rad_s2,
                    ),)*
                }
            }

            #[inline]
            pub(crate) fn next_event_ns(&self, drives: &Drives) -> i64 {
                let mut next_ns = i64::MAX;
                $($(#[$row])* { next_ns = next_ns.min(self.$module.next_event_ns(&drives.$module)); })*
                next_ns
            }

            #[inline]
            pub(crate) fn settle(&self, drives: &mut Drives, now_ns: i64) {
                $(
                    $(#[$row])*
                    if self.$module.next_event_ns(&drives.$module) <= now_ns {
                        self.$module.settle(&mut drives.$module, now_ns);
                    }
                )*
            }

            pub(crate) fn set_out(&self, states: &States, drives: &mut Drives) {
                $($(#[$row])* { self.$module.set_out(&states.$module, &mut drives.$module); })*
            }

            /// A part of a kind, and the sense in which it slips.
            #[inline]
            pub(crate) fn first_slip(
                &self,
                gyrostat: &Gyrostat,
                time_s: f64,
                state: &State,
                drive: &Drive,
                omega_dot_wb_b_rad_s2: &Vector3<f64>,
            ) -> Option<(Part, f64)> {
                $(
                    $(#[$row])*
                    {
                        let slip = self.$module.first_slip(gyrostat, time_s, state, drive, omega_dot_wb_b_rad_s2);
                        if let Some((member, sense)) = slip {
                            return Some((Part { kind: Kind::$kind, member }, sense));
                        }
                    }
                )*
                None
            }

            /// The part that stops first, and roughly when [s].
            #[inline]
            pub(crate) fn first_stop(
                &self,
                from: &States,
                to: &States,
                drives: &Drives,
                h_s: f64,
            ) -> Option<(Part, f64)> {
                let mut first: Option<(Part, f64)> = None;
                $(
                    $(#[$row])*
                    {
                        let stop = self.$module.first_stop(&from.$module, &to.$module, &drives.$module, h_s);
                        if let Some((member, stop_s)) = stop
                            && first.is_none_or(|(_, earliest_s)| stop_s < earliest_s)
                        {
                            first = Some((Part { kind: Kind::$kind, member }, stop_s));
                        }
                    }
                )*
                first
            }

            pub(crate) fn speed(&self, states: &States, part: Part) -> f64 {
                match part.kind {
                    $($(#[$row])* Kind::$kind => self.$module.speed(&states.$module, part.member),)*
                }
            }

            pub(crate) fn slide(&self, states: &mut States, drives: &mut Drives, part: Part, sense: f64) {
                match part.kind {
                    $($(#[$row])* Kind::$kind => {
                        self.$module.slide(&mut states.$module, &mut drives.$module, part.member, sense);
                    })*
                }
            }

            pub(crate) fn sample(
                &self,
                kind: Kind,
                states: &States,
                drives: &Drives,
                sensors: &SensorSuite,
                noise: &mut dyn FnMut() -> f64,
            ) -> JointSample {
                match kind {
                    $($(#[$row])* Kind::$kind => {
                        self.$module.sample(&states.$module, &drives.$module, sensors, noise)
                    })*
                }
            }

            pub(crate) fn command(&self, drives: &mut Drives, kind: Kind, command: &[f64]) {
                match kind {
                    $($(#[$row])* Kind::$kind => self.$module.command(&mut drives.$module, command),)*
                }
            }
        }

        /// A row of the table: its place in everything that is listed by kind.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Kind {
            $(
                $(#[$row])*
                #[doc = concat!("See [`", stringify!($module), "`].")]
                $kind,
            )*
        }

        /// Number of kinds.
        pub const KINDS: usize = [$($(#[$row])* stringify!($module)),*].len();

        impl Actuators {
            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds(&self) -> [&dyn ActuatorKind; KINDS] {
                [$($(#[$row])* &self.$module),*]
            }

            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds_mut(&mut self) -> [&mut dyn ActuatorKind; KINDS] {
                [$($(#[$row])* &mut self.$module),*]
            }

            /// Prior of these actuators from drawings and bench tests.
            #[must_use]
            pub fn typical_priors(&self) -> ActuatorPriors {
                ActuatorPriors { $($(#[$row])* $module: $module::$prior::typical(&self.$module)),* }
            }
        }

        impl Kind {
            /// Every kind, in the order of the table.
            pub const ALL: [Self; KINDS] = [$($(#[$row])* Self::$kind),*];
        }

        impl ActuatorPriors {
            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds(&self) -> [&dyn KindPrior; KINDS] {
                [$($(#[$row])* &self.$module),*]
            }

            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds_mut(&mut self) -> [&mut dyn KindPrior; KINDS] {
                [$($(#[$row])* &mut self.$module),*]
            }
        }
    };
}

register! {
    wheels: Wheels, WheelPriors;
    jets: Jets, JetPriors;
    moving_masses: MovingMasses, MovingMassPriors;
    // Shows that a kind needs only its folder and a row; used only in the tests of this crate.
    #[cfg(test)]
    control_moment_gyros: ControlMomentGyros, GyroPriors;
}

/// One moving part of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    kind: Kind,
    member: usize,
}

impl Actuators {
    /// Whether every actuator is valid and can be simulated.
    ///
    /// # Errors
    /// The first that is not, in the order of the table.
    pub fn check(&self) -> Result<(), ActuatorError> {
        self.kinds().into_iter().try_for_each(ActuatorKind::check)
    }

    /// The motors of each kind among all motors of the platform.
    #[must_use]
    pub fn motor_ranges(&self) -> [Range<usize>; KINDS] {
        let mut first = 0;
        self.kinds().map(|kind| {
            let count = if kind.channel().is_some() { kind.names().len() } else { 0 };
            first += count;
            first - count..first
        })
    }

    /// What every motor can do now, in the order of the table; effects in the unit of each motor's command.
    pub fn motors(&self, joints: &[Joints; KINDS], effects: &[f64], motors: &mut [Motor]) {
        for ((kind, range), joints) in self.kinds().into_iter().zip(self.motor_ranges()).zip(joints) {
            if let Some(motors) = motors.get_mut(range.clone()) {
                kind.motors(joints, effects.get(range).unwrap_or(&[]), motors);
            }
        }
    }

    /// Momentum that the moving parts have relative to the body, body axes [N m s].
    #[must_use]
    pub fn momentum_b_n_m_s(&self, joints: &[Joints; KINDS]) -> Vector3<f64> {
        let momentum = |(kind, joints): (&dyn ActuatorKind, &Joints)| kind.momentum_b_n_m_s(joints);
        self.kinds().into_iter().zip(joints).map(momentum).fold(Vector3::zeros(), |sum, part| sum + part)
    }
}
