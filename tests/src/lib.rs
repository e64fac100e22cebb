//! Integration tests of Whorl: see `integration.rs`. This library is empty; Cargo wants one beside tests.
