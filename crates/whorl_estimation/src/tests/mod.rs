//! Tests of the whole filter against a truth that shares no code with it.

mod accuracy;
mod all_filters;
mod contradicted;
mod gates;
mod optimum;
mod recovery;
