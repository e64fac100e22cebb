//! Comparisons of simulated runs, of which the answer is known.

mod comparisons;
mod generator;
mod smoothed;
mod statistics;
mod whereabouts;
