//! Orientation of a sensor that moves freely: gyro, accelerometer and magnetometer.
//!
//! An air-bearing platform turns about a fixed point; a sensor in a hand, on a limb or on a trolley does not, and
//! its accelerometer shows its own acceleration beside gravity. [`FreeMotionFilter`] is an inertial navigation
//! filter that uses four facts about such motion:
//!
//! - it stays in a room: the specific force is integrated to velocity and position in a frame that does not turn, and
//!   a drift away from the room shows an error of the inclination (Gauss-Markov motion, instead of a low-pass on
//!   the vertical);
//! - sometimes it rests: then gyro bias, velocity and the field's change are observed directly;
//! - the magnetic field of a room is not uniform: the field's east component wanders as the sensor moves, and with it the
//!   heading that the magnetometer shows. North is where the field points at the start. How much the components that do
//!   not depend on the heading differ from those at the start says how far the east component may be trusted elsewhere.
//! - iron and magnets on the sensor itself turn with it: their field is estimated and subtracted from the samples.
//!
//! [`DirectionFilter`] is for vehicles that have directions and no accelerometer, or none that shows the vertical: satellites,
//! for example. [`smooth`] runs either over a whole recording, forwards and backwards.
//!
//! The attitude error is a rotation vector in world axes (x east, y magnetic north, z up).

mod anchor;
mod axes;
mod clipping;
mod contradicted;
#[cfg(test)]
mod contradiction_tests;
mod covariance;
mod directions;
mod field;
mod filter;
#[cfg(test)]
mod imperfect_tests;
mod iron;
mod magnetised;
mod orientation;
mod orientation_error;
mod parameters;
mod rest;
#[cfg(test)]
mod smoothing_tests;
mod still_field;

#[cfg(test)]
mod tests;

pub use axes::{AxisCheck, Contradiction, doubts};
pub use clipping::Clipping;
pub use directions::{DirectionFilter, DirectionParameters};
pub use filter::{FreeMotionEstimate, FreeMotionFilter};
pub use magnetised::{FreeMotionEstimator, Smoothed, smooth_free_motion};
pub use orientation::{Observed, Orientation, OrientationFilter, Sample, backward, forward, smooth};
pub use orientation_error::{OrientationErrors, orientation_error};
pub use parameters::FreeMotionParameters;
