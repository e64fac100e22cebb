//! The answer: the posterior, the verdict, estimates, words.

pub(crate) mod answer;
pub(crate) mod diagnosis;
mod digits;
mod noise;
pub(crate) mod posterior;
mod remarks;
mod rows;

pub(crate) use remarks::missing_channels;
