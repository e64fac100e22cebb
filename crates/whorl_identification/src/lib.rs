//! What recordings say about a model: its mass properties and other constants, and which physical effect it lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`]
//! refits the model jointly with named effects; [`identify()`] determines mass properties and what goes with them. All of them take the
//! likelihood of the readings themselves, with priors ([`whorl_prediction`]).
//!
//! # Method
//!
//! The platform's own parameters are fitted to every sample. One pass of the causal filter about that fit has a column for every effect of
//! the catalogue, so that thousands of sets of effects are ranked by linear algebra; the few that may win are fitted, each with the noise
//! that is likeliest beside it, and are tried on held-out runs. The posterior is prior odds times evidence. See METHOD.md of this crate.
//!
//! Source of names and equation numbers: J. L. Schwartz, *The Distributed Spacecraft Attitude Control
//! System Simulator*, Ph.D. dissertation, Virginia Tech, 2004, sections 4.2-4.4 and 4.6. Where its
//! equations are in error the module says so; `docs/errata.md` has the list.
//!
//! Frames, signs and units: see `whorl_math`.

pub mod balance;
mod case;
mod diagnose;
mod discovery;
mod error;
mod fitting;
mod grammar;
mod identification;
mod options;
mod parameter_space;
mod selection;
mod settings;
mod signals;
#[cfg(test)]
mod tests;
mod threads;
mod verdict;

pub use diagnose::{diagnose, with_low_passes_that_delay};
pub use discovery::{Discovery, DiscoveryError, EvaluatedLaw, FittedValue, discover};
pub use error::DiagnosisError;
pub use fitting::fitter::fit;
pub use fitting::refit::{Fit, FittedParameter};
pub use fitting::ties::Tie;
pub use identification::{Determined, Identification, identify, predict};
pub use options::{Options, Progress};
pub use selection::information::{ExpectedInformation, InformationByRun, expected_information};
pub use settings::{Allowed, Setting, Settings};
pub use signals::readings::usable_readings;
pub use verdict::diagnosis::{
    BackgroundTorque, Candidate, Diagnosis, Explanation, FittedSet, NextManoeuvre, NoiseScale,
    ParameterEstimate, ParameterOfSet, SCHEMA, SlowResidual, Termination, Unknown, Verdict,
};
pub use whorl_recording::Finding;
