//! Records every topic into a run directory.
