//! Rotations, conventions and small numerical tools, shared by every crate of Whorl.
//!
//! # Conventions
//!
//! Every crate follows this page; `conventions` (a test module of this crate) pins each
//! line with numbers.
//!
//! - **Units**: SI and radians. Public scalars carry their unit in the name
//!   (`_rad _rad_s _n_m _n_m_s _kg_m2 _s _hz`).
//! - **World frame** `world`: east-north-up, so `k = [0, 0, 1]` points up (REP-103). The
//!   dissertation's local frame is south-east-zenith.
//! - **Body frame** `body`: x forward, y left, z up when the platform is level. Its origin is
//!   the centre of rotation.
//! - **Attitude** `q_world_body`: Hamilton quaternion, active,
//!   `v_world = q_world_body * v_body`; this is [`nalgebra::UnitQuaternion`] and
//!   `sensor_msgs/Imu.orientation`. Kinematics: `q_dot = 1/2 q (x) [0, omega_wb_b]`. The
//!   dissertation's `R^{bi}` is the transpose of our `R(q_world_body)`; its eqs. (4.1)-(4.3)
//!   order and write products differently, and its (4.6) omits the factor 1/2.
//! - **Body rate** `omega_wb_b`: rate of the body seen from the world, in body axes.
//! - **Accelerometer**: specific force (REP-145), `+9.81 m/s^2` on z when level and at rest,
//!   `y = omega_dot x r + omega x (omega x r) + g R^T k`. The gravity sign of the
//!   dissertation's eq. (4.40) is the opposite.
//! - **Gravity torque** about the centre of rotation: `r_cg x (m g R^T (-k))`. With
//!   `mgr_z < 0` the centre of mass hangs below the bearing and level is stable.
//! - **Inertia entries are matrix elements**: a product of inertia `I_xy` is the off-diagonal
//!   element itself, with its sign.
//! - **Attitude error** of an actual against a reference attitude:
//!   `q_actual = q_reference * exp(error)`, a rotation vector in body axes ([`attitude_error`]).
//!
//! # Source
//!
//! J. L. Schwartz, *The Distributed Spacecraft Attitude Control System Simulator*, Ph.D.
//! dissertation, Virginia Tech, 2004: section 4.2.1, eqs. (4.1)-(4.7).

mod allan;
mod attitude;
mod constants;
#[cfg(test)]
mod conventions;
pub mod covariance;
mod euler;
mod growing_curve;
pub mod lanes;
pub mod least_squares;
pub mod line;
mod mrp;
pub mod noise;
pub mod normal_equations;
mod number;
pub mod random_walk;
pub mod resonance;
mod rotation_vector;
pub mod spectrum;
pub mod statistics;
pub mod threads;
mod two_vector;
mod vector;
pub mod words;

pub use allan::{AllanPoint, NoiseDensities, allan_deviation, noise_densities};
pub use attitude::{
    attitude_error, attitude_from_vertical, azimuth_rad, elevation_x_rad, integrate_rate, quaternion_rate,
    roll_rad, tilt_rad, vertical_b,
};
pub use constants::{
    CELSIUS_ZERO_K, GRAVITY_M_S2, deg_from_rad, rad_from_deg, rad_s_from_rpm, rpm_from_rad_s, wrap_angle_rad,
};
pub use euler::{EulerAngles, EulerSequence, GimbalLock};
pub use growing_curve::GrowingCurve;
pub use mrp::ModifiedRodrigues;
pub use number::three_digits;
pub use rotation_vector::{quaternion_exp, right_jacobian, rotation_vector};
pub use two_vector::{TwoVectorError, attitude_from_two_vectors};
pub use vector::{DegenerateVector, skew, unit, unit_or};
