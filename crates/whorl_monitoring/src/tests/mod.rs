//! Of each part by itself; of all together: `whorl_sim`, `tests/integration/model_monitor.rs`.

mod cell;
mod directions;
mod evidence;
mod sources;
mod watch;
