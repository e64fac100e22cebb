//! ROS 2 parameter files to validated types, with errors that name file, line, key, value and what
//! is allowed.
//!
//! ```
//! use whorl_params::{ParameterTree, Reader, range};
//!
//! struct Parameters {
//!     rate_hz: f64,
//! }
//!
//! // The single definition of a node's parameters: names, ranges, defaults, docs.
//! fn read(r: &mut Reader<'_>) -> Parameters {
//!     Parameters { rate_hz: r.f64_or("rate_hz", 100.0, range(1.0..=1000.0), "update rate [Hz]") }
//! }
//!
//! let file = "/whorl_1/estimator:\n  ros__parameters:\n    rate_hz: 5000\n";
//! let tree = ParameterTree::from_texts(&[("whorl_1.yaml", file)], &[])?;
//! let errors = whorl_params::read(&tree.for_node("/whorl_1/estimator"), read).map(|_| ()).unwrap_err();
//! assert_eq!(
//!     errors.to_string(),
//!     "whorl_1.yaml:3: rate_hz = 5000.0: allowed: a number from 1 to 1000 (update rate [Hz])"
//! );
//! # Ok::<(), whorl_params::ParameterErrors>(())
//! ```
//!
//! The format for those who write the files:
//!
#![doc = include_str!("../README.md")]

mod catalogue;
pub mod changes;
mod command_line;
mod descriptor;
mod document;
mod edit;
mod effect_file;
mod error;
mod formation;
mod limits;
mod missing;
mod node_parameters;
mod node_pattern;
mod platform_model;
mod reader;
mod scalar;
mod sections;
mod serialise;
mod shared_groups;
mod span;
#[cfg(test)]
mod tests;
mod tree;
mod value;

pub use catalogue::{ListedDefault, ListedParameter, list_parameters};
pub use command_line::Override;
pub use descriptor::{Descriptor, NumericRange};
pub use edit::{set_in_file, set_in_text};
pub use effect_file::{
    EFFECTS_FOLDER, effect_files_beside, effect_yaml, load_effect, load_effects_beside, read_effect,
};
pub use error::{Origin, ParameterError, ParameterErrors};

pub use formation::{Formation, LAW_ON_PLATFORMS, formation, own_platform};
pub use limits::{Limits, any, non_negative, positive, range};
pub use missing::missing;
pub use node_parameters::{Entry, NodeParameters};
pub use platform_model::{
    ModelStep, PlatformPrior, PriorEntry, model_history, platform_model, platform_model_with_prior,
    truth_model,
};
pub use reader::{Reader, read, read_shared, try_read};
pub use serialise::effective_yaml;
pub use shared_groups::{SHARED_GROUPS, is_shared};
pub use span::Span;
pub use tree::{ParameterTree, layers_of_experiment, standard_layers};
pub use value::{Kind, Value};
