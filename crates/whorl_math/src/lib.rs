//! Rotations, conventions and small numerical tools.
