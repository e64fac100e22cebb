//! The node set as real processes over DDS, on the loopback interface: one fault after the other.

mod addresses;
mod clock_steps;
mod command_silence;
mod experiment;
mod forged;
mod hardware;
mod held;
mod jet_failure;
mod leader_stale;
mod link_cut;
mod links;
mod live;
mod many_participants;
mod node_deaths;
mod operator;
mod policies;
mod recorder;
mod replay_backend;
mod rogue;
mod secure;
mod sensor_faults;
mod services;
mod start;
mod tilt_limit;
mod ways_to_hold;
