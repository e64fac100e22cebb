//! Allocation of torque to jets and motors: quadratic program, pulse modulation, exact oracle.
//!
//! # The problem
//!
//! Jets give torque b_j u_j with on-time fractions u_j in 0..=1; motors give g_i w_i, where w_i is the command (of
//! a wheel the *motor torque on the wheel*, of a gimbal its rate) and g_i the torque on the body per unit of it (of
//! a wheel its spin axis with a minus sign, the body turns the other way). A demand tau
//! is met as far as it can be, without ever turning it:
//!
//! sum b_j u_j + sum g_i w_i = alpha tau,  0 <= alpha <= 1
//!
//! minimise  sum c_j u_j + e/2 sum u_j^2 + W/2 sum ((w_i - desired_i) / limit_i)^2
//!           + F/2 |net force|^2 - M alpha
//!
//! with gas rates c_j, a curvature e so small that it costs at most 1e-4 of the gas, the price W of
//! missing the command that momentum management desires, and (off by default, the bearing takes
//! it) the price F of net force. [`Allocator::allocate`] answers; [`pulses`] turns fractions into
//! valve pulses; [`zonotope`] computes the exact answer by geometry.
//!
//! # Which path answers
//!
//! 1. Nothing asked, or the free effectors linearly independent (three wheels, say): the solution is
//!    unique and linear in alpha, and no program is needed ([`Status::ClosedForm`]).
//! 2. Otherwise, without a price of net force: the dual method. The share alpha comes from the facets of the attainable set,
//!    so it is exact; the cost is then separable and three prices of torque decide everything. Newton's method finds them
//!    without a start, and the answer counts only when it satisfies the conditions of optimality ([`Status::Solved`], `exact`).
//! 3. With net force priced, or when that proof fails: Clarabel solves the program, with the demand as a column of the
//!    constraints, updated in place. Without a price of net force its price of torque is a second start for the dual method;
//!    with one, which couples the effectors, the interior point is moved onto the torque equation (`exact: false`).
//! 4. When there is no such allocation, or both solvers fail: the fallback.
//!
//! On 76,000 seeded demands over five layouts (random, along axes, with random bounds and stuck jets, saturated; with every
//! single jet failed in turn) the dual method proved all 68,513 optima that exist; none differs from the result with Clarabel's start
//! by more than 7e-8 of an on-time fraction. With 12 jets and 3 wheels it takes 9 us instead of 47 us (medians):
//! `cargo bench -p whorl_allocation`.
//!
//! # Fallback rules
//!
//! [`Status::Fallback`] says why; the answer is always admissible and never a panic.
//!
//! | reason | when | answer |
//! |---|---|---|
//! | [`FallbackReason::NoEffector`] | nothing may move and a torque is wanted | everything at rest |
//! | [`FallbackReason::DirectionUnattainable`] | alpha would be zero: a failed jet or a missing wheel leaves no torque along the demand | bounded least squares |
//! | [`FallbackReason::BoundsExcludeDemand`] | lower bounds (a stuck-open jet, a wheel that must slow down) force a torque that no share of the demand matches | bounded least squares |
//! | [`FallbackReason::NotSolved`] | both solvers failed | bounded least squares |
//!
//! Bounded least squares comes as near to tau as it can. It may turn the torque: an axis that cannot
//! be controlled must not take the others with it. `alpha` is then the achieved part along tau.
//! A caller that would rather do nothing reads the status. Malformed demands (NaN, crossed bounds,
//! wrong counts) are errors, not fallbacks: [`TorqueDemandError`].
//!
//! # Limits
//!
//! Torque is taken as proportional to on-time within a slot: valve delays, tank pressure and thrust
//! during wheel spin-up belong to whoever builds [`Effectors`] and the bounds. With motors and jets in
//! one program, jets fire for momentum only where W times the miss saves more than the gas costs.
//!
//! # Sources
//!
//! W. C. Durham, "Constrained Control Allocation", J. Guidance, Control, and Dynamics 16(4), 1993
//! (attainable moments); M. Bodson, "Evaluation of Optimization Methods for Control Allocation", same
//! journal 25(4), 2002 (direction-preserving form); P. J. Goulart and Y. Chen, "Clarabel", 2024 (solver).

mod allocation;
mod allocator;
mod authority;
mod closed_form;
mod demand;
mod dual;
mod effectors;
#[cfg(test)]
mod layouts;
mod least_squares;
mod list;
mod problem;
pub mod pulses;
mod quadratic_program;
#[cfg(test)]
mod tests;
pub mod zonotope;

pub use allocation::{Allocation, FallbackReason, SolverOutcome, Status};
pub use allocator::Allocator;
pub use authority::missing_torque;
pub use demand::{JetMask, Mode, TorqueDemand, TorqueDemandError};
pub use effectors::{EffectorError, EffectorLayout, Effectors, MAX_JETS, MAX_MOTORS};
pub use list::ListError;
pub use quadratic_program::AllocatorError;
