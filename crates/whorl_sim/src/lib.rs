//! Deterministic in-process simulation of the whole node set.
