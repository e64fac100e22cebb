//! The sealed challenge.
//!
//! A judge must be independent of what it judges. This crate simulates a platform with equations of motion,
//! its own integrator, formulas and noise ([`truth`], [`scenario`]), hides an effect in it whose
//! size is set by what the data can show ([`detectability`]), and scores the result of the diagnosis.

#![allow(clippy::indexing_slicing, reason = "indices run over sizes fixed by construction")]
#![allow(missing_docs, reason = "a program: fields say what they are")]

pub mod cases;
pub mod detectability;
pub mod scenario;
pub mod score;
pub mod truth;
pub mod write;
