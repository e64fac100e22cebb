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
//! To add a kind: write a folder beside the others and name it in the table below. A kind with motors needs a
//! field in `ActuatorCommand.msg`, named in `whorl_msgs`' `motor_commands`, and a topic; a test of local control says
//! which is missing. `control_moment_gyros` is the example.

/// The table of kinds: passes its rows on to a macro.
macro_rules! with_kinds {
    ($then:ident) => {
        $then! {
            wheels: Wheels, WheelPriors;
            jets: Jets, JetPriors;
            moving_masses: MovingMasses, MovingMassPriors;
            control_moment_gyros: ControlMomentGyros, GyroPriors;
        }
    };
}

mod dynamics;
mod field;
mod kind;
mod motion;
mod motors;
#[cfg(test)]
mod tests;

pub(crate) use dynamics::{Instant, OnBody};
pub use field::{Allowed, Field, Slot};
pub use kind::{ActuatorError, ActuatorKind, Group, KindPrior, MotorChannel};
pub use motion::States;
pub(crate) use motion::{Drives, Forces, Part};
pub use motors::{Joints, Motor};

use std::ops::Range;

use nalgebra::Vector3;

macro_rules! parts {
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

with_kinds!(parts);

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
            let count = if kind.channel().is_some() { kind.count() } else { 0 };
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

    /// Commands that every motor should have for its own sake, in the order of the table; see
    /// [`ActuatorKind::prefer`].
    pub fn prefer(&self, joints: &[Joints; KINDS], preferred: &mut [f64]) {
        for ((kind, range), joints) in self.kinds().into_iter().zip(self.motor_ranges()).zip(joints) {
            if let Some(preferred) = preferred.get_mut(range) {
                kind.prefer(joints, preferred);
            }
        }
    }

    /// Whether the direction of some motor's torque changes as it moves, so that all may come to lie in one plane.
    #[must_use]
    pub fn may_be_singular(&self) -> bool {
        self.kinds().into_iter().any(|kind| kind.may_be_singular() && kind.count() > 0)
    }

    /// Momentum that the moving parts have relative to the body, body axes [N m s].
    #[must_use]
    pub fn momentum_b_n_m_s(&self, joints: &[Joints; KINDS]) -> Vector3<f64> {
        let momentum = |(kind, joints): (&dyn ActuatorKind, &Joints)| kind.momentum_b_n_m_s(joints);
        self.kinds().into_iter().zip(joints).map(momentum).fold(Vector3::zeros(), |sum, part| sum + part)
    }
}
