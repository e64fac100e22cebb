//! Orbits of a chief and its deputies, formations of them, and where they must point together.
//!
//! Pure: time is an argument. SI units, radians. Frames: `eci` is inertial, its z axis the Earth's; `hill` is
//! the chief's rotating frame (radial, near-velocity, orbit-normal). Equation numbers are of J. L. Schwartz,
//! *The Distributed Spacecraft Attitude Control System Simulator*, Ph.D. dissertation, Virginia Tech, 2004,
//! chapter 2.
//!
//! | module | what | equations |
//! |---|---|---|
//! | [`elements`] | classical elements, Kepler's equation | |
//! | [`differences`] | relative orbital elements | 2.36, 2.37 |
//! | [`propagation`] | two-body in closed form; two-body with J2, numerically | 2.1-2.4 |
//! | [`hill`] | the chief's frame, relative states | 2.6-2.8 |
//! | [`relative_motion`] | full nonlinear relative motion | 2.12, 2.15, 2.18-2.20 |
//! | [`clohessy_wiltshire`] | its linearisation about a circle, closed form and numerical | 2.25-2.34 |
//! | [`yamanaka_ankersen`] | the same about an ellipse: state-transition matrix | |
//! | [`formation`] | in-plane, in-track, circular, projected circular | |
//! | [`drift`] | equal energies or secular rates: what stops two orbits drifting apart | 2.31 |
//! | [`earth`] | the ellipsoid of WGS 84, geodetic and geocentric latitude | |
//! | [`co_observation`] | targets, desired attitudes | 2.38, Figure 2.1 |
//! | [`pass`] | every spacecraft over a pass: orbit, relative state, attitude | |
//! | [`flight`] | the pass with its wanted velocity changes carried out: thrust where the attitude points it, gas | 2.38 |
//! | [`mean_elements`] | orbits without what the oblateness adds within a revolution, and how they turn | |
//! | [`formation_keeping`] | a law that holds a deputy in a box for days, thrust and gas | |
//! | [`laboratory`] | the pass scaled to the laboratory, and whether platforms can follow it | |
//!
//! Misprints in the dissertation: the right side of (2.5) holds for neither
//! spacecraft alone (`rho` is the difference of two of (2.1)), and the second line of (2.17) belongs to
//! (2.16) as a whole. (2.18)-(2.20) and all after them are used as printed.

pub mod burn;
pub mod clohessy_wiltshire;
pub mod co_observation;
pub mod differences;
pub mod drift;
pub mod earth;
pub mod elements;
pub mod flight;
pub mod formation;
pub mod formation_keeping;
pub mod hill;
pub mod laboratory;
pub mod mean_elements;
pub mod pass;
pub mod propagation;
pub mod relative_motion;
pub mod yamanaka_ankersen;

mod orbit_state;
mod runge_kutta;
#[cfg(test)]
mod support;

pub use elements::{Elements, OrbitError};
pub use hill::HillState;
pub use orbit_state::OrbitState;
pub use propagation::Propagator;

/// Gravitational parameter of the Earth \[m^3/s^2\] (EGM96).
pub const EARTH_MU_M3_S2: f64 = 3.986_004_418e14;
/// Equatorial radius of the Earth \[m\] (WGS 84).
pub const EARTH_RADIUS_M: f64 = 6_378_137.0;
/// Second zonal harmonic of the Earth (EGM96).
pub const EARTH_J2: f64 = 1.082_626_68e-3;
/// Sidereal rotation rate of the Earth \[rad/s\].
pub const EARTH_RATE_RAD_S: f64 = 7.292_115e-5;
