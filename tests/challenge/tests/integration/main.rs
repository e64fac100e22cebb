//! The challenge's physics against the library's, and a small fixed part of the challenge itself.

mod filter;
mod motion;
mod score;
mod small_rigs;
mod valves;
