//! Attitude references: what the tracking law follows, and how they are shaped.
//!
//! - [`Reference`]: attitude, rate and acceleration of a moving target frame, and its
//!   extrapolation in time.
//! - [`Validity`]: how a reference that is no longer renewed comes to rest.
//! - [`TiltEnvelope`]: attitudes that the air bearing allows, with a margin.
//! - [`Slew`]: a smooth rest-to-rest manoeuvre inside the envelope.
//! - [`CommandFilter`]: a second-order reference model on SO(3) that follows a noisy or jumping
//!   goal with bounded rate and acceleration.

mod command_filter;
mod extrapolation;
mod slew;
mod smooth_trapezoid;
mod tilt;

pub use command_filter::{CommandFilter, CommandFilterError, CommandFilterSettings};
pub use extrapolation::{Extrapolated, Validity};
pub use slew::{Slew, SlewLimits, SlewLimitsError};
pub use smooth_trapezoid::{ProfilePoint, SmoothTrapezoid};
pub use tilt::{EnvelopeError, TiltEnvelope};

use nalgebra::{UnitQuaternion, Vector3};

/// A moving reference frame at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// Attitude of the reference in the world: `v_world = q_world_reference * v_reference`.
    pub q_world_reference: UnitQuaternion<f64>,
    /// Rate of the reference seen from the world, in reference axes \[rad/s\].
    pub omega_wr_r_rad_s: Vector3<f64>,
    /// Time derivative of that rate, in reference axes \[rad/s^2\].
    pub omega_dot_wr_r_rad_s2: Vector3<f64>,
}

impl Reference {
    /// A reference that stands still.
    #[must_use]
    pub fn at_rest(q_world_reference: UnitQuaternion<f64>) -> Self {
        Self {
            q_world_reference,
            omega_wr_r_rad_s: Vector3::zeros(),
            omega_dot_wr_r_rad_s2: Vector3::zeros(),
        }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.q_world_reference.coords.iter().all(|x| x.is_finite())
            && self.omega_wr_r_rad_s.iter().all(|x| x.is_finite())
            && self.omega_dot_wr_r_rad_s2.iter().all(|x| x.is_finite())
    }

    /// The reference turned by a constant offset: the frame `o` with
    /// `q_world_offset = q_world_reference * q_reference_offset`, its rate and acceleration
    /// expressed in its own axes.
    #[must_use]
    pub fn with_offset(&self, q_reference_offset: &UnitQuaternion<f64>) -> Self {
        let to_offset = q_reference_offset.inverse();
        Self {
            q_world_reference: self.q_world_reference * q_reference_offset,
            omega_wr_r_rad_s: to_offset * self.omega_wr_r_rad_s,
            omega_dot_wr_r_rad_s2: to_offset * self.omega_dot_wr_r_rad_s2,
        }
    }
}
