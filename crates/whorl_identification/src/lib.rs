//! What recordings say about a model: its mass properties and other constants, and which physical effect it lacks.
//!
//! [`diagnose`] compares recordings with the model of the platform and ends in a verdict; [`fit`] refits the model jointly with named effects;
//! [`identify()`] determines mass properties and what goes with them. All of them take the likelihood of the readings themselves, with priors
//! ([`whorl_prediction`]): see METHOD.md of this crate.
//!
//! Source of names and equation numbers: J. L. Schwartz, *The Distributed Spacecraft Attitude Control System Simulator*, Ph.D. dissertation, Virginia
//! Tech, 2004, sections 4.2-4.4 and 4.6; `docs/errata.md` lists where its equations are in error. Frames, signs and units: see `whorl_math`.

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
mod verdict;

pub use diagnose::diagnose;
pub use discovery::{Discovery, EvaluatedLaw, FittedValue, discover};
pub use error::DiagnosisError;
pub(crate) use error::Outcome;
pub use fitting::fit;
pub use fitting::refit::{Fit, FittedParameter};
pub use fitting::tie::Tie;
pub use identification::{Determined, Identification, identify, predict};
pub use options::{Options, Progress};
pub use selection::information::{ExpectedInformation, expected_information};
pub use settings::Settings;
pub use verdict::diagnosis::{
    BackgroundTorque, Candidate, Diagnosis, Explanation, FittedSet, NextManoeuvre, NoiseScale,
    ParameterEstimate, ParameterOfSet, SlowResidual, Termination, Unknown, Verdict,
};
pub use whorl_recording::Finding;
