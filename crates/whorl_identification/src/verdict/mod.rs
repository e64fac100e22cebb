//! The answer: the posterior, the verdict, estimates, words.

pub(crate) mod answer;
pub(crate) mod diagnosis;
mod digits;
pub(crate) mod posterior;
mod remarks;
mod rows;
mod runs;
mod trace;

pub(crate) use remarks::missing_channels;
