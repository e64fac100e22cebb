//! What may explain the data: effects of the catalogue and how each can enter, laws without a name, lines and vibrations.

pub(crate) mod candidates;
pub(crate) mod hypothesis;
pub(crate) mod lines;
pub(crate) mod modes;
pub(crate) mod physical;
pub(crate) mod place;
pub(crate) mod shapes;
pub(crate) mod spectrum;
pub(crate) mod vibration;
