//! Thruster and wheel allocation: quadratic program, pulse modulation, exact oracle.
