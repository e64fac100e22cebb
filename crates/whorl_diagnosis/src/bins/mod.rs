//! Recordings on nodes: bins, integrated inputs, measured noise, and the motion about which everything is linearised.

pub(crate) mod environment;
pub(crate) mod feedback;
pub(crate) mod inputs;
pub(crate) mod jitter;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod run;
pub(crate) mod torques;
