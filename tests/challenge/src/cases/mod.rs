//! Cases: a hidden truth, the recordings that show it, and the input of the tool.

pub mod build;
pub mod catalogue;
pub mod foreign;
pub mod plan;

pub use build::{Built, Laboratory, build};
pub use plan::{Cell, Spec, all_specs};
