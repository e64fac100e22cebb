//! Cases: a hidden truth, the recordings that show it, and what the tool is given.

pub mod build;
pub mod catalogue;
pub mod foreign;
pub mod plan;

pub use build::{Built, Laboratory, build};
pub use plan::{Cell, Spec, all_specs};
