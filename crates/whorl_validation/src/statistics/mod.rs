//! Tests of residuals: are they white, and do they correlate with an input?

mod correlation;
mod ljung_box;
mod periodogram;

pub use correlation::{CrossCorrelation, autocorrelation, cross_correlation};
pub use ljung_box::{LjungBox, ljung_box};
pub use periodogram::{CumulativePeriodogram, cumulative_periodogram};

/// Two-sided 99 % quantile of the standard normal distribution.
pub const NORMAL_99: f64 = 2.575_829_303_548_901;
