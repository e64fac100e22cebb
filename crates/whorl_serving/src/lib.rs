//! What `whorl live` and `whorl open` share: a page that a program serves to browsers of its own machine.
//!
//! - [`Door`] is the listener: what a stranger may send, for how long, and how many may stand in it.
//! - [`Places`] bound those who hold a WebSocket.
//! - [`token`]: what a browser must know to command, in the fragment of the address, which browsers send to nobody.
//! - [`same_site`] refuses pages of other sites, and lets the door know who asks.
//! - [`states`] is a WebSocket that has the latest of something that changes.

mod door;
mod places;
mod site;
mod states;
pub mod token;

pub use door::{Door, Visitor};
pub use places::{Place, Places};
pub use site::{Site, same_site};
pub use states::{FRAMES, PATIENCE, states};
