//! Campaigns: many simulated runs of one or more experiments over parameters, seeds, faults and links; or one question to many
//! recordings.
//!
//! A campaign is a folder. Its plan lists the tasks: each is independent, deterministic, and done when its row exists. An engine
//! distributes them: threads of this machine, or a cluster, which runs parts of the plan as tasks. Whatever the engine, and whoever
//! is interrupted, the rows are the same.
//!
//! | module | what |
//! |---|---|
//! | [`definition`] | the campaign file |
//! | [`plan`] | every run that follows from it |
//! | [`recordings`] | the campaign file over recordings, and the list of these |
//! | [`run_spec`] | specification of one run |
//! | [`work`] | tasks, their rows in the folder, and computing them on threads |
//! | `store` | where the folder is: a directory, or object storage |
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
pub mod recordings;
pub mod row;
pub mod run_spec;
pub mod single;
pub mod slurm;
mod store;
pub mod table;
#[cfg(test)]
mod tests;
pub mod work;

pub use definition::Definition;
pub use part::Part;
pub use plan::Plan;
pub use row::Row;
pub use run_spec::RunSpec;
