//! Tests of the allocation as a whole.

mod dual;
mod oracle;
mod program;
mod pulses;
mod refusals;
