//! Campaigns: many simulated runs of one or more experiments over parameters, seeds, faults and links.
//!
//! A campaign is a folder. Its plan lists the runs. A run is claimed by creating a file, and done when its row
//! exists. Threads, processes, machines that share the folder and resumed campaigns all follow this rule, and
//! the rows do not depend on who computes them.
//!
//! | module | what |
//! |---|---|
//! | [`definition`] | the campaign file |
//! | [`plan`] | every run that follows from it |
//! | [`run_spec`] | specification of one run |
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
