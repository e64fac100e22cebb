//! The sealed challenge.
//!
//! A judge must be independent of the judged. This crate simulates a platform with equations of motion,
//! an integrator, formulas and noise of its own ([`truth`], [`scenario`]), hides an effect in it whose
//! size is set by what the data can show ([`detectability`]), and scores what the diagnosis says.

#![allow(clippy::indexing_slicing, reason = "indices run over sizes fixed by construction")]
#![allow(missing_docs, reason = "a program: fields say what they are")]

pub mod cases;
pub mod detectability;
pub mod scenario;
pub mod score;
pub mod truth;
pub mod write;
