//! Tests of the allocation as a whole.

mod oracle;
mod program;
mod pulses;
mod refusals;
