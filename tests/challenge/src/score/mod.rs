//! From answers to a score.

pub mod judge;
pub mod table;

pub use judge::{Outcome, judge};
pub use table::{Row, table};
