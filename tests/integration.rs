//! Whorl as a whole.
//!
//! - `closed_loop`: the node set in one simulated process: accuracy, determinism, links, faults.
//! - `replay`: single cores reproduce recordings, bit for bit.
//! - `fuzz`: any message into any core.
//! - `ros`: the node set as real processes over DDS, one fault after the other.
//! - `structure`: what the sources must look like.
//! - `workbench`: `whorl open` in a browser.
//!
//! The processes' programs are those that cargo builds with the tests. README.md tells of variables and of what needs
//! root.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

mod closed_loop;
mod doc_examples;
mod fuzz;
mod replay;
mod ros;
mod structure;
mod support;
mod workbench;
