//! Attitude tracking, reference shaping, relative-attitude laws and momentum management.
//!
//! Everything here is pure: time, measurements and settings are arguments.

pub mod reference;
