//! The contract between a node's pure core and the shells that run it: time, events, outputs.
