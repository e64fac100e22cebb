//! The whorl command.
