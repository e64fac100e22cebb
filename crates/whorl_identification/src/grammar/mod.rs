//! Candidate laws: a torque that is a coefficient times a function of recorded quantities, about an axis.
//!
//! The quantities are one table ([`variable`]), with the names by which answers call them. Of them are made the shapes that compete as laws
//! without a name in a diagnosis ([`unlisted`]), and the terms among which `whorl discover` searches ([`terms`]).

pub(crate) mod terms;
pub(crate) mod unlisted;
pub(crate) mod variable;

/// Root mean square of a column of a law, as a share of that of the applied torques.
pub(crate) const SHARE: f64 = 0.02;

/// Prior sizes of a law that are tried, in units of its columns.
pub(crate) const SIZES: [f64; 4] = [0.3, 3.0, 30.0, 300.0];
