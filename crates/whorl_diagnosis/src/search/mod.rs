//! Which sets come near the best one, each fitted and evaluated where it fits best.

pub(crate) mod converge;
pub(crate) mod evaluate;
pub(crate) mod expected_information;
pub(crate) mod initial_guesses;
pub(crate) mod judge;
pub(crate) mod latency;
pub(crate) mod noise_optimisation;
pub(crate) mod prior;
pub(crate) mod proposals;
pub(crate) mod residual;
pub(crate) mod sampled;
pub(crate) mod score;
pub(crate) mod step;
pub(crate) mod unmodelled;

pub(crate) use proposals::Search;
