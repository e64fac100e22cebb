//! The answer: the posterior, the verdict, estimates, words.

pub(crate) mod answer;
pub(crate) mod direct;
pub(crate) mod fit;
pub(crate) mod gimbals;
pub(crate) mod posterior;
pub(crate) mod report;
mod rows;
mod trace;
pub(crate) mod unrecorded;
pub(crate) mod words;
