//! Platform model: gyrostat, mass properties, actuators, sensors and the catalogue of physical effects.

pub mod mass_properties;
pub mod platform;

pub use mass_properties::MassProperties;
pub use platform::PlatformModel;
