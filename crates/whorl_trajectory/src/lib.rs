//! What the data of a run say before anything is explained.
//!
//! Comparison, identification and diagnosis stand on the same few steps, and each has its home here.
//!
//! - [`spectrum`]: Fourier transforms of series.

pub mod spectrum;
