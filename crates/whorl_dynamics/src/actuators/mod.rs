//! The kinds of actuator: one kind, one folder.
//!
//! A kind's folder says what one of its actuators is made of and how that stands in parameter files
//! ([`ActuatorKind`]), and how well it is known before any fit ([`KindPrior`]). To add a kind: write a folder
//! beside the others and name it in `register!` below; whatever reads, writes or counts actuators walks over
//! that table.

mod field;
mod kind;
mod motors;
#[cfg(test)]
mod tests;

pub use field::{Allowed, Field, Slot};
pub use kind::{ActuatorError, ActuatorKind, Group, KindPrior, MotorChannel};
pub use motors::{Joints, Motor};

use std::ops::Range;

use nalgebra::Vector3;

macro_rules! register {
    ($($module:ident: $kind:ident, $prior:ident;)*) => {
        $(pub mod $module;)*

        /// The actuators of a platform by kind.
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct Actuators {
            $(
                #[doc = concat!("See [`", stringify!($module), "`].")]
                pub $module: $module::$kind,
            )*
        }

        /// How well the actuators of a platform are known, by kind.
        #[derive(Debug, Clone, PartialEq)]
        pub struct ActuatorPriors {
            $(
                #[doc = concat!("See [`", stringify!($module), "`].")]
                pub $module: $module::$prior,
            )*
        }

        /// A row of the table: its place in everything that is listed by kind.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum Kind {
            $(
                #[doc = concat!("See [`", stringify!($module), "`].")]
                $kind,
            )*
        }

        /// Number of kinds.
        pub const KINDS: usize = [$(stringify!($module)),*].len();

        impl Actuators {
            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds(&self) -> [&dyn ActuatorKind; KINDS] {
                [$(&self.$module),*]
            }

            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds_mut(&mut self) -> [&mut dyn ActuatorKind; KINDS] {
                [$(&mut self.$module),*]
            }

            /// What a careful builder knows of these actuators from drawings and bench tests.
            #[must_use]
            pub fn typical_priors(&self) -> ActuatorPriors {
                ActuatorPriors { $($module: $module::$prior::typical(&self.$module)),* }
            }
        }

        impl ActuatorPriors {
            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds(&self) -> [&dyn KindPrior; KINDS] {
                [$(&self.$module),*]
            }

            /// Every kind, in the order of the table.
            #[must_use]
            pub fn kinds_mut(&mut self) -> [&mut dyn KindPrior; KINDS] {
                [$(&mut self.$module),*]
            }
        }
    };
}

register! {
    wheels: Wheels, WheelPriors;
    jets: Jets, JetPriors;
    moving_masses: MovingMasses, MovingMassPriors;
}

impl Actuators {
    /// Whether every actuator is one that can exist and be simulated.
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
