//! Fits: models with parameters at their likeliest values.
pub(crate) mod fitter;
pub(crate) mod low_pass;
pub(crate) mod normal_equations;
pub(crate) mod refit;
pub(crate) mod ties;
