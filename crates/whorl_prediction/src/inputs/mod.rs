//! What a recording says of the inputs of its platform: commands as the model's actuators receive them, speeds of wheels whose commands were
//! not recorded and the torques that explain them, supplies.

pub(crate) mod commands;
pub(crate) mod driven_speeds;
mod quiet;
pub(crate) mod wheel_torque;

pub(crate) use quiet::quiet;
