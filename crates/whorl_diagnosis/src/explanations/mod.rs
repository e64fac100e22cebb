//! What may explain the data: effects of the catalogue and how each can enter, unmodelled laws, lines and vibrations.

pub(crate) mod candidates;
pub(crate) mod hypothesis;
pub(crate) mod lines;
pub(crate) mod modes;
pub(crate) mod physical;
pub(crate) mod place;
pub(crate) mod shapes;
pub(crate) mod spectrum;
pub(crate) mod vibration;
