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
//!
//! Source of the taxonomy: Schwartz 2004, section 2.4.

mod graph;
mod law;
mod leader_follower;
mod limits;
mod shaper;
mod virtual_structure;
mod yaw_pitch_roll;

#[cfg(test)]
mod law_tests;
#[cfg(test)]
mod shaper_tests;

pub use graph::{GraphError, LeaderGraph};
pub use law::{Demand, Goals, LawError, LawInput, Member, Offset, Relation, RelativeAttitudeLaw};
pub use leader_follower::LeaderFollower;
pub use limits::{LimitsError, ReferenceLimits};
pub use shaper::{ReferenceShaper, Shaped};
pub use virtual_structure::{VirtualStructure, VirtualStructureGains};
pub use yaw_pitch_roll::{YawPitchRoll, YawPitchRollMotion};
