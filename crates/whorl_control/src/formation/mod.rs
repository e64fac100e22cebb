//! Relative-attitude laws: the demand for each platform of a formation, given the states of all.
//!
//! One law, one file: its equations, source, stability and assumptions, its settings with their docs and ranges, and what the
//! experiment's steps need to know. To add a law: write a file beside the others and name it in `register!` below.
//!
//! A law ([`RelativeAttitudeLaw`]) turns the state of every platform, the references they follow now
//! and the experiment's [`Goals`] into one [`MotionDemand`] per platform. It knows neither limits nor
//! links: the caller decides which states are usable and passes every demand through a
//! [`ReferenceShaper`], which owns the platform's reference and keeps it smooth and inside its
//! rate, acceleration and tilt limits whatever the demand does. So switching laws, a link that
//! returns and a goal that jumps are all bumpless for the same reason.
//!
//! | law | file | graph |
//! |---|---|---|
//! | [`LeaderFollower`] | `leader_follower.rs` | any forest: pair, chain, tree, parallel leaders |
//! | [`VirtualStructure`] | `virtual_structure.rs` | none: all follow one virtual body |
//! | [`Behavioural`] | `behavioural.rs`, `keep_out.rs` | mutual neighbours |
//! | [`Decentralised`] | `decentralised.rs`, `traffic.rs` | any that the goal reaches all platforms over |
//! | [`PerceptiveFrame`] | `perceptive_frame.rs` | none: all are perceived together |
//!
//! Source of the taxonomy: Schwartz 2004, section 2.4.

mod graph;
mod keep_out;
mod law;
mod limits;
mod neighbours;
mod plan;
mod registry;
mod settings;
mod shaper;
mod traffic;
mod yaw_pitch_roll;

#[cfg(test)]
mod convergence_tests;
#[cfg(test)]
mod inertia_tests;
#[cfg(test)]
mod law_tests;
#[cfg(test)]
mod registry_tests;
#[cfg(test)]
mod shaper_tests;

pub use graph::{GraphError, LeaderGraph};
pub use keep_out::KeepOut;
pub use law::{Goals, LawInput, Member, MotionDemand, Offset, Relation, RelativeAttitudeLaw, TypedLaw};
pub use limits::{LimitsError, ReferenceLimits};
pub use neighbours::{Listening, NeighbourError, NeighbourGraph};
pub use registry::RegisteredLaw;
pub use settings::{Allowed, LawError, Roster, Settings};
pub use shaper::{ReferenceShaper, Shaped};
pub use traffic::TrafficCap;
pub use yaw_pitch_roll::{YawPitchRoll, YawPitchRollMotion};

macro_rules! register {
    ($($module:ident::$law:ident),* $(,)?) => {
        $(
            mod $module;
            pub use $module::*;
        )*

        /// Every law.
        #[must_use]
        pub fn catalogue() -> &'static [RegisteredLaw] {
            static CATALOGUE: &[RegisteredLaw] = &[$(RegisteredLaw::of::<$law>()),*];
            CATALOGUE
        }
    };
}

register! {
    leader_follower::LeaderFollower,
    virtual_structure::VirtualStructure,
    behavioural::Behavioural,
    decentralised::Decentralised,
    perceptive_frame::PerceptiveFrame,
}

/// The law with this name.
#[must_use]
pub fn find(kind: &str) -> Option<&'static RegisteredLaw> {
    catalogue().iter().find(|law| law.kind() == kind)
}
