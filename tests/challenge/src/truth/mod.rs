//! The challenge's own simulator, which uses no code of the library under test.

pub mod body;
pub mod filter;
pub mod foreign;
pub mod hidden;
pub mod law;
pub mod motion;
pub mod run;
pub mod valves;

pub use body::{Body, Constant, G_M_S2};
pub use foreign::Foreign;
pub use hidden::Hidden;
pub use law::DrawnLaw;
pub use motion::{Mechanics, Motion, WHEELS};
pub use run::{Plan, SLOT_S, Trace, simulate};
