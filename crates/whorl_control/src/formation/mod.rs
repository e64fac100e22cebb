//! Relative-attitude laws: what each platform of a formation is asked to do, given what all of them do.
//!
//! A law ([`RelativeAttitudeLaw`]) turns the state of every platform, the references they follow now
//! and the experiment's [`Goals`] into one [`Demand`] per platform. It knows neither limits nor
//! links: the caller decides which states are usable and passes every demand through a
//! [`ReferenceShaper`], which owns the platform's reference and keeps it smooth and inside its
//! rate, acceleration and tilt limits whatever the demand does. So switching laws, a link that
//! returns and a goal that jumps are all bumpless for the same reason.
//!
//! | law | file | graph |
//! |---|---|---|
//! | [`LeaderFollower`] | `leader_follower.rs` | any forest: pair, chain, tree, parallel leaders |
//! | [`VirtualStructure`] | `virtual_structure.rs` | none: all hang on one virtual body |
//! | [`Behavioural`] | `behavioural.rs`, `keep_out.rs` | mutual neighbours |
//! | [`Decentralised`] | `decentralised.rs`, `traffic.rs` | any that the goal reaches all platforms over |
//! | [`PerceptiveFrame`] | `perceptive_frame.rs` | none: all are perceived together |
//!
//! Source of the taxonomy: Schwartz 2004, section 2.4.

mod behavioural;
mod decentralised;
mod graph;
mod keep_out;
mod law;
mod leader_follower;
mod limits;
mod neighbours;
mod perceptive_frame;
mod shaper;
mod traffic;
mod virtual_structure;
mod yaw_pitch_roll;

#[cfg(test)]
mod convergence_tests;
#[cfg(test)]
mod inertia_tests;
#[cfg(test)]
mod law_tests;
#[cfg(test)]
mod shaper_tests;

pub use behavioural::{Behavioural, BehaviouralSettings};
pub use decentralised::{Decentralised, DecentralisedSettings};
pub use graph::{GraphError, LeaderGraph};
pub use keep_out::KeepOut;
pub use law::{Demand, Goals, LawError, LawInput, Member, Offset, Relation, RelativeAttitudeLaw};
pub use leader_follower::LeaderFollower;
pub use limits::{LimitsError, ReferenceLimits};
pub use neighbours::{Listening, NeighbourError, NeighbourGraph};
pub use perceptive_frame::{PerceptiveFrame, PerceptiveFrameGains};
pub use shaper::{ReferenceShaper, Shaped};
pub use traffic::TrafficCap;
pub use virtual_structure::{VirtualStructure, VirtualStructureGains};
pub use yaw_pitch_roll::{YawPitchRoll, YawPitchRollMotion};
