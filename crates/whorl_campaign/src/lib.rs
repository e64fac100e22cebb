//! Campaigns: many simulated runs of one or more experiments over parameters, seeds, faults and links.
//!
//! A campaign is a folder. Its plan lists the runs: each is independent, deterministic, and done when its row exists. An engine
//! distributes them: threads of this machine, or a cluster, which runs parts of the plan as tasks. A run is claimed by creating a
//! file where nobody else keeps two workers from it. Whatever the engine, and whoever is interrupted, the rows are the same.
//!
//! | module | what |
//! |---|---|
//! | [`definition`] | the campaign file |
//! | [`plan`] | every run that follows from it |
//! | [`run_spec`] | specification of one run |
//! | [`work`] | claims and rows in the folder |
//! | [`part`] | tasks: parts of a campaign that an engine distributes |
//! | [`slurm`] | the engine for clusters: an array job |
//! | [`single`] | one run, in memory |
//! | [`row`] | the numbers of a run |
//! | [`table`] | all rows, and percentiles over what was swept |
//! | [`page`] | percentile plots |

pub mod definition;
pub mod page;
pub mod part;
pub mod plan;
pub mod row;
pub mod run_spec;
pub mod single;
pub mod slurm;
pub mod table;
#[cfg(test)]
mod tests;
pub mod work;

pub use definition::Definition;
pub use part::Part;
pub use plan::Plan;
pub use row::Row;
pub use run_spec::RunSpec;
