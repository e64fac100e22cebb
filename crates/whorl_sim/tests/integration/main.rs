//! The node set in one process, on clocks that differ, with mass properties estimated, without a ground station;
//! parameters that no node takes.

mod clocks;
mod mass_properties;
mod model_monitor;
mod on_platforms;
mod refused;
