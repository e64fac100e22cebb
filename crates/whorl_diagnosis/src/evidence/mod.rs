//! The likelihood: normal equations, errors of formulas, noise of unknown size, and what is left.

pub(crate) mod ar_noise;
pub(crate) mod discrepancy;
pub(crate) mod excess;
pub(crate) mod nuisance;
pub(crate) mod problem;
pub(crate) mod regression;
