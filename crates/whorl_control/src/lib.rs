//! Attitude tracking, reference shaping, relative-attitude laws and momentum management.
//!
//! Everything here is pure: time, measurements and settings are arguments.
//!
//! | module | what for | used by |
//! |---|---|---|
//! | [`mod@reference`] | moving references, slews, command filter, tilt envelope | coordinator, local control |
//! | [`excitation`] | torque signals and pulses for identification | local control |
//! | [`formation`] | relative-attitude laws | coordinator |
//! | [`tracking`] | the quaternion tracking law | local control |
//! | [`mass_balancing`] | moving the linear actuators until the gravity offset is at its target | local control |
//! | [`momentum`] | unloading of the wheels by the jets | local control |
//! | [`safe_mode`] | rate damping, then coasting | local control |

pub mod excitation;
pub mod formation;
pub mod mass_balancing;
pub mod momentum;
pub mod reference;
pub mod safe_mode;
pub mod tracking;

pub use reference::Reference;
