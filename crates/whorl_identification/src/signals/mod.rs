//! What the samples show directly beside a fit: lines, resonances, vibrations, turning wheels.

mod fast;
pub(crate) mod lines;
pub(crate) mod observed;
pub(crate) mod seen;
#[cfg(test)]
mod tests;

pub(crate) use observed::{Observed, observed, remains_of};
