//! Integration tests of Whorl.
