//! Platform model, truth plant and the catalogue of physical effects.
//!
//! [`PlatformModel`] describes the parts of a platform. [`gyrostat::equation`] is the equation of motion that plant,
//! filters, tracking law, identification and diagnosis share; [`Gyrostat`] is a platform with its physical effects in
//! that equation. [`Plant`] integrates it between actuator events and samples its sensors.
//! [`actuators`] has one folder for each kind of actuator.
//! [`effects`] is the catalogue: one effect, one file, used to simulate, fit and compensate; everything that
//! these uses need is in its file.

pub mod actuators;
pub mod balance;
pub mod effects;
mod environment;
pub mod gyrostat;
pub mod mass_parameters;
pub mod mass_properties;
pub mod plant;
pub mod platform;
pub mod realisability;
pub mod sensing;
mod supplies;
#[cfg(test)]
mod validation;

pub use actuators::{ActuatorError, Actuators};
pub use effects::{Effect, EffectError, EffectInfo, EffectKind, EffectSet, ParameterSpec, TrueImu};
pub use environment::Environment;
pub use gyrostat::{Gyrostat, GyrostatError, State};
pub use mass_parameters::{MassCovariance, MassVector};
pub use mass_properties::{INERTIA_TOLERANCE, MassProperties};
pub use plant::{CommandError, InitialState, JetFailure, Plant, PlantError, Pulse, TrueMotion, Truth};
pub use platform::{Freedom, ModelPrior, PlatformModel};
pub use supplies::{Course, MeasuredSupplies};
