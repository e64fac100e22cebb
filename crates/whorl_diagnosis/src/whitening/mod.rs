//! From readings to white innovations: the equations along the motion, the filter, and the sensitivities that pass through it.

pub(crate) mod columns;
pub(crate) mod filter;
pub(crate) mod mechanics;
