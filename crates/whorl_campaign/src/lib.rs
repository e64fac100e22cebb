//! Campaigns: many simulated runs of one or more experiments over parameters, seeds, faults and links.
//!
//! A campaign is a folder. Its plan says which runs there are; a run is claimed by creating a file, and done when its
//! row is there. So threads, processes, machines that share the folder and a campaign that goes on after an
//! interruption all work by the same rule, and rows are the same whoever computes them.
//!
//! | module | what |
//! |---|---|
//! | [`definition`] | the campaign file |
//! | [`plan`] | every run that follows from it |
//! | [`run_spec`] | what one run is |
//! | [`work`] | claims and rows in the folder |
//! | [`single`] | one run, in memory |
//! | [`row`] | the numbers of a run |
//! | [`table`] | all rows, and percentiles over what was swept |
//! | [`page`] | percentile plots |

pub mod definition;
pub mod page;
pub mod plan;
pub mod row;
pub mod run_spec;
pub mod single;
pub mod table;
#[cfg(test)]
mod tests;
pub mod work;

pub use definition::Definition;
pub use plan::Plan;
pub use row::Row;
pub use run_spec::RunSpec;
